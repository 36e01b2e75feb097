// SPDX-License-Identifier: Apache-2.0
//
// Keeps the answers to one peer apart, and bounds what all peers together are sent: it is shared by
// those that were answered lately. What was sent may have been lost on the way, so nothing counts
// as delivered: after a while the same keyframe may go out again. A drone that comes towards a
// place finds nothing in one answer after the other until it is near enough: the longer nothing is
// heard of answers, the rarer they get.
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
    double resend_interval_s = 2.0;  // before one peer gets the same keyframe again, or, where it
                                     // finds nothing, another one
    std::size_t max_peers = 64;      // at a time: who invents more names gets no answer
    double landmarks_per_s = 370;    // that all peers share; 0: no bound
    int least_landmarks = 40;        // of an answer; if shares are smaller, answers get rarer
    int max_landmarks = 85;          // of an answer
  };

  explicit AnswerLimiter(const Config& config);

  [[nodiscard]] bool allows(const std::string& peer, TimeNs now_ns) const;
  // Of an answer to this peer now.
  [[nodiscard]] int max_landmarks(const std::string& peer, TimeNs now_ns) const;
  // Too lately to be sent again.
  [[nodiscard]] bool has_just_sent(const std::string& peer, std::uint64_t keyframe_id,
                                   TimeNs now_ns) const;
  // Lately, as long as it matters for the intervals.
  [[nodiscard]] bool has_sent(const std::string& peer, std::uint64_t keyframe_id) const;
  // `awaits_word`: the peer will say so if it finds something.
  void sent(const std::string& peer, std::uint64_t keyframe_id, TimeNs now_ns,
            bool awaits_word = false);
  // It has found something of what it was sent.
  void found(const std::string& peer) { unheard_of_.erase(peer); }

 private:
  // How many share what is sent if this one is answered as well.
  [[nodiscard]] std::size_t sharers(const std::string& peer, TimeNs now_ns) const;
  struct Share {
    int landmarks = 0;      // of an answer
    double interval_s = 0;  // between two answers
  };
  [[nodiscard]] Share share_of(const std::string& peer, TimeNs now_ns) const;
  // Times as long as usual, until the peer is answered again.
  [[nodiscard]] double patience(const std::string& peer) const;

  void forget_silent(TimeNs now_ns);  // those that were not answered lately

  Config config_;
  double memory_s_;  // in which even the most peers are all answered once
  // By peer: when each own keyframe was sent, as far as it matters for the intervals.
  std::map<std::string, std::map<std::uint64_t, TimeNs>> sent_ns_;
  // By peer: answers in a row of which no word has come.
  std::map<std::string, int> unheard_of_;
};

}  // namespace covey
