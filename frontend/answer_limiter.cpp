// SPDX-License-Identifier: Apache-2.0
#include "frontend/answer_limiter.h"

#include <algorithm>
#include <cmath>

namespace covey {

AnswerLimiter::AnswerLimiter(const Config& config) : config_(config) {
  constexpr double kLeast_s = 6, kLate = 1.2;  // nobody asks just when it may
  const auto most = static_cast<double>(config.max_peers);
  const int least = std::min(config.least_landmarks, config.max_landmarks);
  const double round_s = config.landmarks_per_s > 0 ? most * least / config.landmarks_per_s : 0;
  memory_s_ = std::max({kLeast_s, kLate * round_s, config.resend_interval_s});
}

std::size_t AnswerLimiter::sharers(const std::string& peer, TimeNs now_ns) const {
  const auto is_sharer = [&](const auto& other) {
    return other.first == peer ||
           std::any_of(other.second.begin(), other.second.end(), [&](const auto& sent) {
             return seconds_between(sent.second, now_ns) < memory_s_;
           });
  };
  const auto known = std::count_if(sent_ns_.begin(), sent_ns_.end(), is_sharer);
  return static_cast<std::size_t>(known) + (sent_ns_.count(peer) == 0 ? 1 : 0);
}

AnswerLimiter::Share AnswerLimiter::share_of(const std::string& peer, TimeNs now_ns) const {
  const int most = config_.max_landmarks;
  if (config_.landmarks_per_s == 0) return {most, config_.answer_interval_s};
  const double per_s = config_.landmarks_per_s / static_cast<double>(sharers(peer, now_ns));
  const int landmarks = std::clamp(static_cast<int>(per_s * config_.answer_interval_s),
                                   std::min(config_.least_landmarks, most), most);
  return {landmarks, std::max(config_.answer_interval_s, landmarks / per_s)};
}

double AnswerLimiter::patience(const std::string& peer) const {
  constexpr int kMost = 10;  // of all that count
  const auto unheard = unheard_of_.find(peer);
  return unheard == unheard_of_.end() ? 1 : std::exp2(std::min(unheard->second, kMost));
}

int AnswerLimiter::max_landmarks(const std::string& peer, TimeNs now_ns) const {
  return share_of(peer, now_ns).landmarks;
}

bool AnswerLimiter::allows(const std::string& peer, TimeNs now_ns) const {
  const auto history = sent_ns_.find(peer);
  if (history == sent_ns_.end()) return sharers(peer, now_ns) <= config_.max_peers;
  const double usual_s = share_of(peer, now_ns).interval_s;
  const double apart_s =
      std::min(patience(peer) * usual_s, std::max(usual_s, config_.resend_interval_s));
  return std::all_of(history->second.begin(), history->second.end(), [&](const auto& sent) {
    return seconds_between(sent.second, now_ns) >= apart_s;
  });
}

bool AnswerLimiter::has_just_sent(const std::string& peer, std::uint64_t keyframe_id,
                                  TimeNs now_ns) const {
  const auto history = sent_ns_.find(peer);
  if (history == sent_ns_.end()) return false;
  const auto sent = history->second.find(keyframe_id);
  return sent != history->second.end() &&
         seconds_between(sent->second, now_ns) < config_.resend_interval_s;
}

bool AnswerLimiter::has_sent(const std::string& peer, std::uint64_t keyframe_id) const {
  const auto history = sent_ns_.find(peer);
  return history != sent_ns_.end() && history->second.count(keyframe_id) > 0;
}

void AnswerLimiter::sent(const std::string& peer, std::uint64_t keyframe_id, TimeNs now_ns,
                         bool awaits_word) {
  forget_silent(now_ns);
  std::map<std::uint64_t, TimeNs>& history = sent_ns_[peer];
  const double horizon_s = std::max(config_.resend_interval_s, config_.answer_interval_s);
  for (auto old = history.begin(); old != history.end();) {
    old = seconds_between(old->second, now_ns) > horizon_s ? history.erase(old) : std::next(old);
  }
  history[keyframe_id] = now_ns;
  if (awaits_word) ++unheard_of_[peer];
}

void AnswerLimiter::forget_silent(TimeNs now_ns) {
  for (auto peer = sent_ns_.begin(); peer != sent_ns_.end();) {
    const bool silent = std::none_of(
        peer->second.begin(), peer->second.end(),
        [&](const auto& sent) { return seconds_between(sent.second, now_ns) < memory_s_; });
    if (silent) unheard_of_.erase(peer->first);
    peer = silent ? sent_ns_.erase(peer) : std::next(peer);
  }
}

}  // namespace covey
