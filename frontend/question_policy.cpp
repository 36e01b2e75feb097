// SPDX-License-Identifier: Apache-2.0
#include "frontend/question_policy.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace covey {

bool is_worth_asking(const KeyframeRule& rule, const std::optional<KeyframePose>& last_asked,
                     const KeyframePose& newest, double mean_depth) {
  return !last_asked ||
         is_keyframe(rule, *last_asked, newest.stamp_ns, newest.T_world_cam, mean_depth);
}

bool may_ask_briefly(double corners_interval_s, const QuestionsSoFar& so_far, TimeNs stamp_ns) {
  constexpr double kLonger = 4;
  const auto since_s = [&](const std::optional<TimeNs>& then_ns) {
    return then_ns ? seconds_between(*then_ns, stamp_ns) : std::numeric_limits<double>::infinity();
  };
  const double told_s = since_s(so_far.corners_told_ns);
  return told_s < corners_interval_s ||
         (since_s(so_far.found_ns) < corners_interval_s && told_s < kLonger * corners_interval_s);
}

QuestionPolicy::QuestionPolicy(const QuestionRules& rules) : rules_(rules) {}

bool QuestionPolicy::asks_about(const Keyframe& newest, TimeNs now_ns) {
  const auto last = asked_ ? std::optional(asked_->pose) : std::nullopt;
  if (rules_.new_view && !is_worth_asking(*rules_.new_view, last, newest.pose, newest.mean_depth)) {
    return false;
  }
  asked_ = Asked{newest.pose, now_ns};
  return true;
}

bool QuestionPolicy::repeats(TimeNs now_ns) {
  constexpr double kLongest_s = 60;
  if (!asked_ || asked_->answered || rules_.repeat_s == 0) return false;
  const double patience_s = std::min(std::ldexp(rules_.repeat_s, asked_->repeats), kLongest_s);
  if (seconds_between(asked_->asked_ns, now_ns) < patience_s) return false;
  asked_->asked_ns = now_ns;
  ++asked_->repeats;
  so_far_.corners_told_ns = now_ns;
  return true;
}

bool QuestionPolicy::next_is_brief(TimeNs stamp_ns, TimeNs now_ns) {
  forget_strangers_that_left(now_ns);
  QuestionsSoFar so_far = so_far_;
  double interval_s = rules_.corners_interval_s;
  if (!strangers_.empty()) {
    so_far.found_ns.reset();  // with others
    interval_s /= 4;
  }
  if (may_ask_briefly(interval_s, so_far, stamp_ns)) return true;
  so_far_.corners_told_ns = stamp_ns;
  return false;
}

void QuestionPolicy::note_answer(std::uint64_t keyframe_id) {
  if (asked_ && keyframe_id >= asked_->pose.keyframe_id) asked_->answered = true;
}

void QuestionPolicy::note_match(TimeNs now_ns) { so_far_.found_ns = now_ns; }

void QuestionPolicy::note_stranger(const std::string& drone, TimeNs now_ns) {
  forget_strangers_that_left(now_ns);
  if (strangers_.size() < rules_.max_strangers || strangers_.count(drone) > 0) {
    strangers_[drone] = now_ns;
  }
}

void QuestionPolicy::forget_strangers_that_left(TimeNs now_ns) {
  constexpr double kGone_s = 10;  // without a question
  for (auto stranger = strangers_.begin(); stranger != strangers_.end();) {
    const bool gone = seconds_between(stranger->second, now_ns) > kGone_s;
    stranger = gone ? strangers_.erase(stranger) : std::next(stranger);
  }
}

}  // namespace covey
