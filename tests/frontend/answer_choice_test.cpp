// SPDX-License-Identifier: Apache-2.0
#include "frontend/answer_choice.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

namespace covey {
namespace {

// 40 landmarks in two rows, one 4 m away and one 8 m.
Keyframe keyframe_at(double x, std::uint64_t id) {
  Keyframe keyframe;
  keyframe.pose.keyframe_id = id;
  keyframe.pose.T_world_cam.translation().x() = x;
  keyframe.mean_depth = 6;
  for (int i = 0; i < 40; ++i) {
    KeyframeFeature feature;
    feature.track_id = static_cast<std::uint64_t>(i);
    feature.bearing = {0.03 * (i / 2 - 10), i % 2 == 0 ? 0.1 : -0.1};
    feature.inverse_depth = i % 2 == 0 ? 1.0 / 4 : 1.0 / 8;
    feature.inverse_depth_sigma = 0.01 * feature.inverse_depth;
    keyframe.features.push_back(feature);
  }
  return keyframe;
}

class AnswerChoice : public ::testing::Test {
 protected:
  AnswerChoice() {
    for (int i = 0; i < 4; ++i) keyframes_.push_back(keyframe_at(i, static_cast<unsigned>(i)));
    for (const Keyframe& keyframe : keyframes_) stored_.push_back(&keyframe);
    camera_.fx = camera_.fy = 400;
    camera_.cx = 320;
    camera_.cy = 240;
    camera_.width = 640;
    camera_.height = 480;
    asked_from_.mean_depth = 6;
  }

  [[nodiscard]] std::optional<ChosenAnswer> brief_answer(double x, std::size_t max_landmarks) {
    asked_from_.T_world_cam.translation().x() = x;
    const PlaceAdvert brief;
    return choose_answer(rules_, stored_, {&brief, asked_from_, max_landmarks}, tolerance_,
                         camera_);
  }

  AnswerRules rules_;
  std::vector<Keyframe> keyframes_;
  std::vector<const Keyframe*> stored_;
  CameraIntrinsics camera_;
  CameraView asked_from_;
  ViewpointTolerance tolerance_;
};

TEST_F(AnswerChoice, ABriefQuestionGetsTheNearestViewAndItsNearestLandmarksFirst) {
  const auto answer = brief_answer(2.1, 20);
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->keyframe->pose.keyframe_id, 2U);
  ASSERT_EQ(answer->landmarks.size(), 20U);
  for (const KeyframeFeature& landmark : answer->landmarks) {
    EXPECT_EQ(landmark.inverse_depth, 1.0 / 4);
  }
}

TEST_F(AnswerChoice, ABriefQuestionGetsOnlyWhatIsInItsImage) {
  camera_.width = 330;  // little more than its left half
  const auto answer = brief_answer(2, 40);
  ASSERT_TRUE(answer);
  EXPECT_GT(answer->landmarks.size(), 10U);
  for (const KeyframeFeature& landmark : answer->landmarks) {
    EXPECT_LT(400 * landmark.bearing.x() + 320, 330 - rules_.margin_px);
  }
}

TEST_F(AnswerChoice, ViewsTooFarApartAreNotAnswered) {
  EXPECT_FALSE(brief_answer(40, 40));
  EXPECT_FALSE(brief_answer(2, 5)) << "too few would be found";
}

TEST_F(AnswerChoice, LandmarksOfUncertainDepthAreNotSent) {
  for (Keyframe& keyframe : keyframes_) {
    for (std::size_t i = 0; i < 35; ++i) keyframe.features[i].inverse_depth_sigma = 1;
  }
  EXPECT_FALSE(brief_answer(2, 40));
}

TEST_F(AnswerChoice, NothingStoredNothingSent) {
  stored_.clear();
  EXPECT_FALSE(brief_answer(2, 40));
}

}  // namespace
}  // namespace covey
