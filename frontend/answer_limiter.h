// SPDX-License-Identifier: Apache-2.0
//
// Keeps the answers to one peer apart. What was sent may have been lost on the way, so nothing
// counts as delivered: after a while the same keyframe may go out again.
#pragma once

#include <cstdint>
#include <map>
#include <string>

#include "estimator/measurements.h"

namespace covey {

class AnswerLimiter {
 public:
  struct Config {
    double answer_interval_s = 0.5;  // between two answers to one peer
    double resend_interval_s = 2.0;  // before one peer gets the same keyframe again
    std::size_t max_peers = 64;      // who invents more names gets no answer
  };

  explicit AnswerLimiter(const Config& config) : config_(config) {}

  [[nodiscard]] bool allows(const std::string& peer, TimeNs now_ns) const;
  [[nodiscard]] bool allows(const std::string& peer, std::uint64_t keyframe_id,
                            TimeNs now_ns) const;
  // Lately, as long as it matters for the intervals.
  [[nodiscard]] bool has_sent(const std::string& peer, std::uint64_t keyframe_id) const;
  void sent(const std::string& peer, std::uint64_t keyframe_id, TimeNs now_ns);

 private:
  Config config_;
  // By peer: when each own keyframe was sent, no longer ago than the resend interval.
  std::map<std::string, std::map<std::uint64_t, TimeNs>> sent_ns_;
};

}  // namespace covey
