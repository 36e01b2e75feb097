// SPDX-License-Identifier: Apache-2.0
//
// What a drone asks, answers and keeps of the exchange with its peers.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "frontend/answer_choice.h"
#include "frontend/answer_limiter.h"
#include "frontend/camera.h"
#include "frontend/keyframe_database.h"
#include "frontend/keyframe_matcher.h"
#include "frontend/place_recognition.h"
#include "frontend/question_policy.h"

namespace covey {

// What drones tell each other, and when.
enum class ExchangeMode : std::uint8_t {
  kCompact,  // a question per new view; who has seen the place answers the asker, but not too often
  kPaper,    // the paper's: a question per image, each about a known place is answered
  kNaive,    // what the paper compares with: every image is told to all, nobody asks
};

[[nodiscard]] const char* to_string(ExchangeMode exchange);
[[nodiscard]] std::optional<ExchangeMode> exchange_from_name(const std::string& name);

struct CollaboratorConfig {
  std::string agent = "uav0";  // own name
  ExchangeMode exchange = ExchangeMode::kCompact;

  // Asking and storing.
  KeyframeRule keyframe = {0.07, 0.35, 0.25};
  KeyframeRule question = {0.07, 0.35, 0.35};  // the same, between keyframes that are asked about
  KeyframeDatabase::Config database;
  // s, between questions that carry the place's corners: four times as long while answers match, a
  // quarter of it while a drone is about whose world is not known. Questions in between are brief,
  // and so are their answers: who knows where the asker is needs no descriptors.
  double corners_interval_s = 3.0;
  // s, after which a question that nobody has answered is asked again from where the drone still
  // is; then each time after twice as long, up to a minute. 0: never.
  double repeat_question_s = 3.0;
  double depth_memory_s = 3.0;  // s, over which depths are measured: PeerKeyframe::before

  // Revisiting.
  double loop_min_age_s = 5.0;          // s, of an own keyframe
  double revisit_max_difference = 1.5;  // between the views: way over depth, plus angle (rad)
  int max_revisits = 4;                 // for one keyframe
  std::size_t remembered = 60;          // peers' keyframes, of about 5 kB
  std::size_t recent_frames = 60;       // images that answers find, besides keyframes, of 14 kB

  // Answering.
  PlaceMode place_mode = PlaceMode::kCompact;  // of the compact exchange; others: kPaper
  double place_threshold = 0;     // least score that is answered; 0: default_threshold of the mode
  AnswerLimiter::Config limiter;  // of the compact exchange; the others send all landmarks
  double answer_max_difference = 3.0;  // between the views, as far as they are sure
  int min_landmarks = 8;               // with an estimate, or a keyframe is not worth sending

  // Do landmarks go with pictures in the exchanges of the paper as well, where it has none?
  bool pictures_always = false;

  // Whether who has answered is told what came of it, in the compact exchange.
  bool tell_found = true;

  // Of the landmarks that should be found from the own view, as long as the peer's world is not
  // known: two places that have something in common differ in the rest.
  double least_found_share = 0.8;
  KeyframeMatcherConfig matching;
};

// Throws std::runtime_error if it cannot work.
void require_workable(const CollaboratorConfig& config, const Vocabulary& vocabulary,
                      const CameraIntrinsics& camera);

// With what its exchange fixes: the paper's drones know places by its VLAD and answer whatever they
// know.
[[nodiscard]] CollaboratorConfig for_exchange(CollaboratorConfig config);

[[nodiscard]] QuestionRules question_rules(const CollaboratorConfig& config);
[[nodiscard]] AnswerRules answer_rules(const CollaboratorConfig& config);

}  // namespace covey
