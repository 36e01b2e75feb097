// SPDX-License-Identifier: Apache-2.0
#include "frontend/keyframe_database.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "synthetic_places.h"

namespace covey {
namespace {

using testing::level_camera;

LandmarkEstimate landmark(std::uint64_t id, const Eigen::Vector3d& p_world, double sigma = 0.1) {
  return {id, p_world, sigma * sigma * Eigen::Matrix3d::Identity()};
}

Keyframe keyframe(std::uint64_t id, const Eigen::Vector3d& p_world_cam,
                  const std::vector<std::uint64_t>& tracks = {}) {
  Keyframe result;
  result.id = id;
  result.stamp_ns = nanoseconds(static_cast<double>(id));
  result.T_world_cam = level_camera(p_world_cam);
  result.mean_depth = 10;
  for (const std::uint64_t track : tracks)
    result.features.push_back({track, Eigen::Vector2d::Zero(), {}});
  return result;
}

TEST(MeanDepth, AveragesDepthsAlongTheOpticalAxis) {
  const Eigen::Isometry3d T_world_cam = level_camera({1, 2, 3});
  // 5 m and 15 m deep, each 4 m aside. Averaging inverse depths would give 7.5 m, distances 10.96
  // m.
  const auto depth =
      mean_depth(T_world_cam, {landmark(1, {6, 6, 3}), landmark(2, {16, -2, 3})}, 0.5);
  ASSERT_TRUE(depth.has_value());
  EXPECT_NEAR(*depth, 10.0, 1e-12);
}

TEST(MeanDepth, LeavesOutWhatIsBehindOrUncertain) {
  const Eigen::Isometry3d T_world_cam = level_camera({0, 0, 0});
  const auto depth = mean_depth(
      T_world_cam, {landmark(1, {8, 0, 0}), landmark(2, {-4, 0, 0}), landmark(3, {500, 0, 0}, 400)},
      0.5);
  ASSERT_TRUE(depth.has_value());
  EXPECT_NEAR(*depth, 8.0, 1e-12);
  EXPECT_FALSE(mean_depth(T_world_cam, {}, 0.5).has_value());
  const double nan = std::nan("");
  EXPECT_FALSE(mean_depth(T_world_cam, {landmark(1, {nan, nan, nan})}, 0.5).has_value());
}

TEST(KeyframeRule, BaselineIsMeasuredAgainstTheMeanDepth) {
  const Keyframe last = keyframe(0, {0, 0, 0});
  const KeyframeRule rule;  // 15 %
  const TimeNs later = last.stamp_ns + nanoseconds(1.0);
  EXPECT_FALSE(is_keyframe(rule, last, later, level_camera({0, 1.4, 0}), 10));
  EXPECT_TRUE(is_keyframe(rule, last, later, level_camera({0, 1.6, 0}), 10));
  EXPECT_FALSE(is_keyframe(rule, last, later, level_camera({0, 1.6, 0}), 20));
}

TEST(KeyframeRule, RotationCountsAndHasteDoesNot) {
  const Keyframe last = keyframe(0, {0, 0, 0});
  const KeyframeRule rule;
  const TimeNs later = last.stamp_ns + nanoseconds(1.0);
  EXPECT_FALSE(is_keyframe(rule, last, later, level_camera({0, 0, 0}, 0.3), 10));
  EXPECT_TRUE(is_keyframe(rule, last, later, level_camera({0, 0, 0}, 0.4), 10));
  const TimeNs soon = last.stamp_ns + nanoseconds(0.4);
  EXPECT_FALSE(is_keyframe(rule, last, soon, level_camera({0, 9, 0}), 10));
}

TEST(KeyframeDatabase, KeepsTheNewestEstimateAfterTheFilterDroppedTheTrack) {
  KeyframeDatabase database({});
  database.add(keyframe(1, {0, 0, 0}, {7, 8}));
  EXPECT_EQ(database.landmark(7), nullptr);
  database.update_landmarks({landmark(7, {1, 1, 1}), landmark(99, {5, 5, 5})});
  database.update_landmarks({landmark(7, {2, 2, 2}), landmark(8, {3, 3, 3})});
  database.update_landmarks({});
  ASSERT_NE(database.landmark(7), nullptr);
  EXPECT_EQ(database.landmark(7)->p_world, Eigen::Vector3d(2, 2, 2));
  ASSERT_NE(database.landmark(8), nullptr);
  EXPECT_EQ(database.landmark(99), nullptr) << "in no keyframe";
}

TEST(KeyframeDatabase, FindsByIdOnly) {
  KeyframeDatabase database({});
  EXPECT_EQ(database.last(), nullptr);
  database.add(keyframe(3, {0, 0, 0}));
  database.add(keyframe(9, {1, 0, 0}));
  ASSERT_NE(database.find(9), nullptr);
  EXPECT_EQ(database.find(9)->id, 9u);
  EXPECT_EQ(database.find(1), nullptr);
  EXPECT_EQ(database.last()->id, 9u);
}

// Round and round on one circle of 20 views, after a lone view elsewhere.
TEST(KeyframeDatabase, IsBoundedAndKeepsOldPlaces) {
  KeyframeDatabase database({30, 5});
  database.add(keyframe(1, {500, 0, 0}, {1}));
  database.update_landmarks({landmark(1, {510, 0, 0})});
  for (std::uint64_t id = 2; id < 402; ++id) {
    const double angle = 2 * M_PI * static_cast<double>(id % 20) / 20;
    database.add(keyframe(id, {20 * std::cos(angle), 20 * std::sin(angle), 0}, {id}));
    database.update_landmarks({landmark(id, {0, 0, 0})});
    ASSERT_LE(database.keyframes().size(), 30u);
  }
  EXPECT_NE(database.find(1), nullptr);
  EXPECT_NE(database.landmark(1), nullptr);
  for (std::uint64_t first_lap = 2; first_lap < 22; ++first_lap) {
    EXPECT_NE(database.find(first_lap), nullptr) << first_lap;
  }
  for (std::uint64_t newest = 397; newest < 402; ++newest) {
    EXPECT_NE(database.find(newest), nullptr) << newest;
  }
  EXPECT_EQ(database.find(200), nullptr);
  EXPECT_EQ(database.landmark(200), nullptr) << "landmarks go with their last keyframe";
}

TEST(KeyframeDatabase, LandmarkStaysAsLongAsAnyKeyframeHoldsItsTrack) {
  KeyframeDatabase database({3, 1});
  database.add(keyframe(1, {0, 0, 0}, {5}));
  database.add(keyframe(2, {0, 0, 0}, {5, 6}));  // the same view: goes first
  database.add(keyframe(3, {50, 0, 0}));
  database.update_landmarks({landmark(5, {1, 0, 0}), landmark(6, {2, 0, 0})});
  database.add(keyframe(4, {100, 0, 0}));
  EXPECT_EQ(database.find(2), nullptr);
  EXPECT_NE(database.landmark(5), nullptr);
  EXPECT_EQ(database.landmark(6), nullptr);
}

TEST(KeyframeDatabase, RefusesACapacityThatLeavesNoChoice) {
  EXPECT_THROW(KeyframeDatabase({21, 20}), std::runtime_error);
}

}  // namespace
}  // namespace covey
