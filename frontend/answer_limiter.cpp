// SPDX-License-Identifier: Apache-2.0
#include "frontend/answer_limiter.h"

#include <algorithm>

namespace covey {

bool AnswerLimiter::allows(const std::string& peer, TimeNs now_ns) const {
  const auto history = sent_ns_.find(peer);
  if (history == sent_ns_.end()) return sent_ns_.size() < config_.max_peers;
  return std::all_of(history->second.begin(), history->second.end(), [&](const auto& sent) {
    return seconds_between(sent.second, now_ns) >= config_.answer_interval_s;
  });
}

bool AnswerLimiter::allows(const std::string& peer, std::uint64_t keyframe_id,
                           TimeNs now_ns) const {
  if (!allows(peer, now_ns)) return false;
  const auto history = sent_ns_.find(peer);
  if (history == sent_ns_.end()) return true;
  const auto sent = history->second.find(keyframe_id);
  return sent == history->second.end() ||
         seconds_between(sent->second, now_ns) >= config_.resend_interval_s;
}

bool AnswerLimiter::has_sent(const std::string& peer, std::uint64_t keyframe_id) const {
  const auto history = sent_ns_.find(peer);
  return history != sent_ns_.end() && history->second.count(keyframe_id) > 0;
}

void AnswerLimiter::sent(const std::string& peer, std::uint64_t keyframe_id, TimeNs now_ns) {
  std::map<std::uint64_t, TimeNs>& history = sent_ns_[peer];
  const double horizon_s = std::max(config_.resend_interval_s, config_.answer_interval_s);
  for (auto old = history.begin(); old != history.end();) {
    old = seconds_between(old->second, now_ns) > horizon_s ? history.erase(old) : std::next(old);
  }
  history[keyframe_id] = now_ns;
}

}  // namespace covey
