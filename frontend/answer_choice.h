// SPDX-License-Identifier: Apache-2.0
//
// Which stored keyframe answers a question, and which of its landmarks go along. Who knows where
// the asker is takes a near view whose landmarks will be found again from there; who does not takes
// what looks most like the place.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "frontend/keyframe_database.h"
#include "frontend/place_recognition.h"
#include "frontend/viewpoint_tolerance.h"

namespace covey {

struct AnswerRules {
  PlaceMode place_mode = PlaceMode::kCompact;
  double least_score = 0;           // of the place's likeness
  double max_difference = 3.0;      // between the views, as far as they are sure
  std::size_t min_landmarks = 8;    // or a keyframe is not worth sending
  double max_relative_sigma = 0.3;  // of a landmark's depth
  double least_finds = 8;           // that must be expected, where it is sure what is in sight
  double margin_px = 8;             // from the border of the asker's image, of what is found there
};

struct Question {
  const PlaceAdvert* advert = nullptr;
  std::optional<CameraView> asked_from;  // in the own world, as far as that is known
  std::size_t max_landmarks = 0;         // of the answer
};

struct ChosenAnswer {
  const Keyframe* keyframe = nullptr;
  std::vector<KeyframeFeature> landmarks;  // the most useful first
};

// A question without the place's corners: only who knows where the asker is can answer.
[[nodiscard]] bool is_brief(const PlaceAdvert& advert);

// Can it be told from there what will look alike?
[[nodiscard]] bool is_sure(const CameraView& view, const ViewpointTolerance& tolerance);

// Nothing if none is worth sending. A brief question needs `asked_from`.
[[nodiscard]] std::optional<ChosenAnswer> choose_answer(const AnswerRules& rules,
                                                        const std::vector<const Keyframe*>& stored,
                                                        const Question& question,
                                                        const ViewpointTolerance& tolerance,
                                                        const CameraIntrinsics& camera);

}  // namespace covey
