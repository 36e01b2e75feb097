// SPDX-License-Identifier: Apache-2.0
//
// When a drone asks its peers what they know of the place in view, and whether the place's corners
// go along.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "estimator/measurements.h"
#include "frontend/keyframe_database.h"

namespace covey {

// Shall the newest keyframe be asked about, or has one from nearly there been?
[[nodiscard]] bool is_worth_asking(const KeyframeRule& rule,
                                   const std::optional<KeyframePose>& last_asked,
                                   const KeyframePose& newest, double mean_depth);

// Stamps of the own image when a question last carried corners, and when an answer last matched.
struct QuestionsSoFar {
  std::optional<TimeNs> corners_told_ns, found_ns;
};
// May a question go without the place's corners? Not `corners_interval_s` after the last that
// carried them; where brief ones bring what they should, four times as long after.
[[nodiscard]] bool may_ask_briefly(double corners_interval_s, const QuestionsSoFar& so_far,
                                   TimeNs stamp_ns);

struct QuestionRules {
  std::optional<KeyframeRule> new_view;  // that is asked about; none: all are
  double corners_interval_s = 3.0;       // may_ask_briefly(); shorter while strangers are about
  double repeat_s = 3.0;                 // after a question that nobody has answered; 0: never
  std::size_t max_strangers = 64;        // at a time
};

// Times are stamps of the newest own image.
class QuestionPolicy {
 public:
  explicit QuestionPolicy(const QuestionRules& rules);

  // Whether the newest keyframe shall be asked about; if so it counts as asked.
  [[nodiscard]] bool asks_about(const Keyframe& newest, TimeNs now_ns);
  // Whether nobody has answered the last question for so long that it shall be asked again; if so
  // that counts as done, with the place's corners.
  [[nodiscard]] bool repeats(TimeNs now_ns);
  // Whether the question that is sent next, about the image of `stamp_ns`, goes without corners; if
  // not they count as told.
  [[nodiscard]] bool next_is_brief(TimeNs stamp_ns, TimeNs now_ns);

  // An answer to this keyframe, or a later one, came and was compared with what was seen.
  void note_answer(std::uint64_t keyframe_id);
  void note_match(TimeNs now_ns);
  // An answer without descriptors fitted nothing: the next question carries corners.
  void want_corners() { so_far_.corners_told_ns.reset(); }

  // Of a drone whose world is not known: it heeds no brief question.
  void note_stranger(const std::string& drone, TimeNs now_ns);
  void forget_stranger(const std::string& drone) { strangers_.erase(drone); }

 private:
  void forget_strangers_that_left(TimeNs now_ns);

  QuestionRules rules_;
  // The newest question.
  struct Asked {
    KeyframePose pose;
    TimeNs asked_ns = 0;  // for the last time
    int repeats = 0;
    bool answered = false;
  };
  std::optional<Asked> asked_;
  QuestionsSoFar so_far_;
  std::map<std::string, TimeNs> strangers_;  // when each asked for the last time
};

}  // namespace covey
