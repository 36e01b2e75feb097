// SPDX-License-Identifier: Apache-2.0
#include "frontend/depth_refinement.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>

#include "synthetic_keyframes.h"

namespace covey {
namespace {

using testing::feature;
using testing::keyframe;
using testing::level_camera;

std::uint64_t by_track(const KeyframeFeature& feature) { return feature.track_id; }

TEST(RefineDepths, SurerDepthsOfTheSameTracksReplaceOldOnes) {
  const Eigen::Vector3d p(10, 1, 0.5);
  Keyframe older = keyframe(1, {0, 0, 0}), newer = keyframe(2, {2, 1, 0});
  for (const std::uint64_t track : {3, 5, 8}) {
    older.features.push_back(feature(track, p, older, 0.2));
    older.features.back().inverse_depth *= 1.2;
  }
  older.features[2].inverse_depth = 0;  // not known until now
  newer.features = {feature(5, p, newer, 0.02), feature(6, p, newer, 0.02),
                    feature(8, p, newer, 0.02)};
  refine_depths(older, newer, by_track);
  EXPECT_NEAR(older.features[0].inverse_depth, 1.2 / 10, 1e-12) << "track 3 is seen no more";
  for (const std::size_t i : {1, 2}) {
    EXPECT_NEAR(older.features[i].inverse_depth, 1.0 / 10, 1e-12);
    // 2 % of 8 m, as a share of 10 m.
    EXPECT_NEAR(older.features[i].inverse_depth_sigma, 0.02 * 0.8 / 10, 1e-12);
  }
}

TEST(RefineDepths, SigmaFollowsTheChangeOfTheDepth) {
  const Eigen::Vector3d p(10, 3, 0.5);
  Keyframe older = keyframe(1, {0, 0, 0}), newer = keyframe(2, {2, 1, 0});
  newer.pose.T_world_cam = level_camera({2, 1, 0}, 0.3);
  const auto refined = [&](double inverse_depth) {
    older.features = {KeyframeFeature{}};
    older.features[0].track_id = 7;
    newer.features = {feature(7, p, newer, 0.02)};
    newer.features[0].inverse_depth = inverse_depth;
    refine_depths(older, newer, by_track);
    return older.features[0];
  };
  const double truth = feature(7, p, newer, 0.02).inverse_depth, step = 1e-6;
  const double slope =
      (refined(truth + step).inverse_depth - refined(truth - step).inverse_depth) / (2 * step);
  EXPECT_NEAR(refined(truth).inverse_depth_sigma, std::abs(slope) * 0.02 * truth, 1e-8);
}

TEST(RefineDepths, WhatIsLessSureChangesNothing) {
  const Eigen::Vector3d p(10, 1, 0.5);
  Keyframe older = keyframe(1, {0, 0, 0}), newer = keyframe(2, {2, 1, 0});
  older.before = keyframe(0, {-1, 0, 0}).pose;
  older.features = {feature(3, p, older, 0.01)};
  newer.features = {feature(3, p + Eigen::Vector3d(1, 0, 0), newer, 0.1)};
  refine_depths(older, newer, by_track);
  EXPECT_NEAR(older.features[0].inverse_depth, 1.0 / 10, 1e-12);
  EXPECT_EQ(older.before.keyframe_id, 0u);
}

TEST(RefineDepths, TheWayOnWhichDepthsWereMeasuredEndsWhereMostWereRefined) {
  const Eigen::Vector3d p(10, 1, 0.5);
  const Keyframe near = keyframe(2, {0.5, 0, 0}), far = keyframe(3, {2, 0, 0});
  for (const Keyframe& end : {near, far}) {
    Keyframe older = keyframe(1, {0, 0, 0}), newer = end;
    older.before = keyframe(0, {-1, 0, 0}).pose;
    older.features = {feature(3, p, older, 0.2), feature(4, p, older, 0.2)};
    newer.features = {feature(3, p, newer, 0.02), feature(4, p, newer, 0.02)};
    refine_depths(older, newer, by_track);
    EXPECT_EQ(older.before.keyframe_id, end.pose.keyframe_id == 3 ? 3u : 0u);
  }
}

// A drone's tracks need not rise with what features are sorted by, if that is one for one track.
TEST(RefineDepths, FeaturesMayBeSortedOtherwiseThanByTrack) {
  struct Sight {
    int landmark = 0;
    std::uint64_t track_id = 0;
    Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
    double inverse_depth = 0, inverse_depth_sigma = 0;
  };
  struct Sights {
    KeyframePose pose, before;
    std::vector<Sight> features;
  };
  Sights older, newer;
  older.features = {{1, 9, {0, 0}, 0.1, 0.02}, {2, 4, {0, 0}, 0.1, 0.02}};
  newer.features = {{1, 11, {0, 0}, 0.2, 0.001}, {2, 4, {0, 0}, 0.2, 0.001}};
  refine_depths(older, newer, [](const Sight& sight) { return sight.landmark; });
  EXPECT_EQ(older.features[0].inverse_depth, 0.1) << "the landmark again, but another track";
  EXPECT_EQ(older.features[1].inverse_depth, 0.2);
}

}  // namespace
}  // namespace covey
