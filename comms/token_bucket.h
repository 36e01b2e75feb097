// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>

namespace covey {

// Fills with `rate` bytes/s up to `burst` bytes. Not thread-safe; times must not go backwards.
class TokenBucket {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // Rate 0: no limit.
  TokenBucket(double rate, double burst) : rate_(rate), burst_(burst), bytes_(burst) {}

  // What is larger than the burst may go when the bucket is full, and leaves a debt.
  [[nodiscard]] bool has(double bytes, Time now) {
    fill(now);
    return rate_ == 0 || bytes_ >= std::min(bytes, burst_);
  }
  void spend(double bytes, Time now) {
    fill(now);
    if (rate_ > 0) bytes_ -= bytes;
  }
  // For what went without being asked: owed up to one burst. More would hold back what comes much
  // later, when the radio has long been free again.
  void spend_unasked(double bytes, Time now) {
    fill(now);
    if (rate_ > 0) bytes_ = std::min(bytes_, std::max(bytes_ - bytes, -burst_));
  }

 private:
  void fill(Time now) {
    const double passed_s = std::chrono::duration<double>(now - filled_).count();
    bytes_ = filled_ == Time() ? burst_ : std::min(burst_, bytes_ + rate_ * passed_s);
    filled_ = now;
  }

  double rate_, burst_, bytes_;
  Time filled_{};
};

}  // namespace covey
