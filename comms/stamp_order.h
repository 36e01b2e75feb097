// SPDX-License-Identifier: Apache-2.0
//
// Which samples of a sensor are believed, by their stamps alone. One wrong stamp far ahead must not
// make all that come after it look late: what is far from the newest is held back until three in a
// row agree. So a wrong stamp costs its own sample, and a real gap, or the start, costs none.
//
// Stamps are in 1..kMaxStampNs (decoders see to it). Not thread-safe.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

// Samples that were left out, since the start.
struct StampCounts {
  std::uint64_t late = 0;      // at most a second behind the newest: out of order, or repeated
  std::uint64_t wrong = 0;     // far from those before and after
  std::uint64_t set_back = 0;  // far behind, and so are those that follow: the clock was set back
  double set_back_s = 0;       // by how much, at last

  [[nodiscard]] std::uint64_t left_out() const { return late + wrong + set_back; }
};

// A sensor that comes less often than once a second is not believed.
template <typename Sample>
class StampOrder {
 public:
  // Those that may be used now, in the order of time.
  std::vector<Sample> add(Sample sample) {
    const TimeNs stamp_ns = sample.stamp_ns;
    const bool as_expected = newest_ && follows(stamp_ns, *newest_);
    if (!as_expected && (is_behind(stamp_ns, newest_) || is_behind_held(stamp_ns)))
      return leave_out(counts_.late);
    if (as_expected || (!held_.empty() && !follows(stamp_ns, held_.back().stamp_ns)))
      give_up_held();
    held_.push_back(std::move(sample));
    if (as_expected) return believe_held();
    if (held_.size() < kAgree) return {};
    return newest_ && stamp_ns < *newest_ ? leave_out_set_back() : believe_held();
  }

  // Those that are held when nothing more comes: believed where there is nothing that speaks
  // against them.
  std::vector<Sample> finish() {
    if (newest_) give_up_held();
    return std::exchange(held_, {});
  }

  // Of the same clock as the newest that is believed, but not newer. Those that are held may be of
  // a clock that was set back.
  [[nodiscard]] bool is_late(TimeNs stamp_ns) const {
    return held_.empty() && is_behind(stamp_ns, newest_);
  }

  [[nodiscard]] const StampCounts& counts() const { return counts_; }

 private:
  static constexpr std::size_t kAgree = 3;
  static constexpr TimeNs kFar_ns = 1'000'000'000;

  static bool follows(TimeNs stamp_ns, TimeNs before_ns) {
    return stamp_ns > before_ns && stamp_ns - before_ns <= kFar_ns;
  }
  static bool is_behind(TimeNs stamp_ns, std::optional<TimeNs> before_ns) {
    return before_ns && stamp_ns <= *before_ns && *before_ns - stamp_ns <= kFar_ns;
  }
  [[nodiscard]] bool is_behind_held(TimeNs stamp_ns) const {
    return !held_.empty() && is_behind(stamp_ns, held_.back().stamp_ns);
  }

  static std::vector<Sample> leave_out(std::uint64_t& count) {
    ++count;
    return {};
  }

  void give_up_held() {
    counts_.wrong += held_.size();
    held_.clear();
  }

  std::vector<Sample> believe_held() {
    newest_ = held_.back().stamp_ns;
    return std::exchange(held_, {});
  }

  // Time does not run backwards for who flies by it. As many stay held as show that the next one is
  // of the same clock.
  std::vector<Sample> leave_out_set_back() {
    counts_.set_back_s = seconds_between(held_.back().stamp_ns, *newest_);
    held_.erase(held_.begin());
    return leave_out(counts_.set_back);
  }

  std::optional<TimeNs> newest_;  // believed
  std::vector<Sample> held_;      // each follows the one before; none follows the newest
  StampCounts counts_;
};

}  // namespace covey
