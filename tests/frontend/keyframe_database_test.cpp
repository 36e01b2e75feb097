// SPDX-License-Identifier: Apache-2.0
#include "frontend/keyframe_database.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <vector>

#include "sim/random.h"
#include "synthetic_keyframes.h"

namespace covey {
namespace {

using testing::feature;
using testing::keyframe;
using testing::level_camera;

TEST(MeanDepth, AveragesDepthsNotInverseDepths) {
  const auto depth = mean_depth({{1, 1.0 / 5, 0.01}, {2, 1.0 / 15, 0.01}}, 0.5);
  ASSERT_TRUE(depth.has_value());
  EXPECT_NEAR(*depth, 10.0, 1e-12);
}

TEST(MeanDepth, LeavesOutWhatIsBehindOrUncertain) {
  const double nan = std::nan("");
  const auto depth =
      mean_depth({{1, 1.0 / 8, 0.01}, {2, -0.25, 0.01}, {3, 0.002, 0.0016}, {4, nan, 0.1}}, 0.5);
  ASSERT_TRUE(depth.has_value());
  EXPECT_NEAR(*depth, 8.0, 1e-12);
  EXPECT_FALSE(mean_depth({}, 0.5).has_value());
  EXPECT_FALSE(mean_depth({{1, nan, nan}}, 0.5).has_value());
}

TEST(ViewDifference, AddsTheWayOverTheDepthAndTheAngle) {
  const CameraView a{level_camera({0, 0, 0}), 8}, b{level_camera({0, 3, 0}, 0.2), 12};
  EXPECT_NEAR(view_difference(a, b), 0.3 + 0.2, 1e-12);
  EXPECT_EQ(view_difference(a, a), 0);
}

TEST(ViewDifference, IsAsUnsureAsPositionOverDepthAndAttitude) {
  Keyframe unsure = keyframe(0, {0, 0, 0});
  unsure.mean_depth = 10;
  unsure.pose.covariance.diagonal() << 4, 1, 4, 0.04, 0.03, 0.02;  // 3 m and 0.3 rad
  EXPECT_NEAR(view_sigma(unsure), 0.3 + 0.3, 1e-12);
}

TEST(MeasuredSince, TheNewestThatIsOldEnoughOrNoWayAtAll) {  // one a second
  const std::vector<Keyframe> keyframes{keyframe(1, {0, 0, 0}), keyframe(2, {0, 1, 0}),
                                        keyframe(3, {0, 2, 0})};
  const KeyframePose newest = keyframe(4, {0, 3, 0}).pose;
  EXPECT_EQ(measured_since(keyframes, newest, 1.5).keyframe_id, 2U);
  EXPECT_EQ(measured_since(keyframes, newest, 3.0).keyframe_id, 1U);
  EXPECT_EQ(measured_since(keyframes, newest, 3.1).keyframe_id, 4U);
  EXPECT_EQ(measured_since(std::vector<Keyframe>(), newest, 3.0).keyframe_id, 4U);
}

TEST(KeyframeRule, BaselineIsMeasuredAgainstTheMeanDepth) {
  const Keyframe last = keyframe(0, {0, 0, 0});
  const KeyframeRule rule;  // 15 %
  const TimeNs later = last.pose.stamp_ns + nanoseconds(1.0);
  EXPECT_FALSE(is_keyframe(rule, last.pose, later, level_camera({0, 1.4, 0}), 10));
  EXPECT_TRUE(is_keyframe(rule, last.pose, later, level_camera({0, 1.6, 0}), 10));
  EXPECT_FALSE(is_keyframe(rule, last.pose, later, level_camera({0, 1.6, 0}), 20));
}

TEST(KeyframeRule, RotationCountsAndHasteDoesNot) {
  const Keyframe last = keyframe(0, {0, 0, 0});
  const KeyframeRule rule;
  const TimeNs later = last.pose.stamp_ns + nanoseconds(1.0);
  EXPECT_FALSE(is_keyframe(rule, last.pose, later, level_camera({0, 0, 0}, 0.3), 10));
  EXPECT_TRUE(is_keyframe(rule, last.pose, later, level_camera({0, 0, 0}, 0.4), 10));
  const TimeNs soon = last.pose.stamp_ns + nanoseconds(0.4);
  EXPECT_FALSE(is_keyframe(rule, last.pose, soon, level_camera({0, 9, 0}), 10));
}

TEST(KeyframeDatabase, FindsByIdOnly) {
  KeyframeDatabase database({});
  EXPECT_EQ(database.last(), nullptr);
  database.add(keyframe(3, {0, 0, 0}));
  database.add(keyframe(9, {1, 0, 0}));
  ASSERT_NE(database.find(9), nullptr);
  EXPECT_EQ(database.find(9)->pose.keyframe_id, 9u);
  EXPECT_EQ(database.find(1), nullptr);
  EXPECT_EQ(database.last()->pose.keyframe_id, 9u);
}

// Round and round on one circle of 20 views, after a lone view elsewhere.
TEST(KeyframeDatabase, IsBoundedAndKeepsOldPlaces) {
  KeyframeDatabase database({30, 5});
  database.add(keyframe(1, {500, 0, 0}));
  for (std::uint64_t id = 2; id < 402; ++id) {
    const double angle = 2 * M_PI * static_cast<double>(id % 20) / 20;
    database.add(keyframe(id, {20 * std::cos(angle), 20 * std::sin(angle), 0}));
    ASSERT_LE(database.keyframes().size(), 30u);
  }
  EXPECT_NE(database.find(1), nullptr);
  for (std::uint64_t first_lap = 2; first_lap < 22; ++first_lap) {
    EXPECT_NE(database.find(first_lap), nullptr) << first_lap;
  }
  for (std::uint64_t newest = 397; newest < 402; ++newest) {
    EXPECT_NE(database.find(newest), nullptr) << newest;
  }
  EXPECT_EQ(database.find(200), nullptr);
}

// Those are compared that are not among the newest.
std::size_t newer_of_the_most_similar(const std::vector<Keyframe>& keyframes,
                                      std::size_t compared) {
  std::size_t redundant = 0;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t newer = 1; newer < compared; ++newer) {
    for (std::size_t older = 0; older < newer; ++older) {
      const double difference =
          view_difference(view_of(keyframes[newer]), view_of(keyframes[older]));
      if (difference >= least) continue;
      least = difference;
      redundant = newer;
    }
  }
  return redundant;
}

TEST(KeyframeDatabase, ForgetsAsIfAllWereComparedWithAllEachTime) {
  constexpr std::size_t kCapacity = 30, kProtected = 5;
  Random random(1, 0xdb);
  KeyframeDatabase database({kCapacity, kProtected});
  std::vector<Keyframe> kept;
  for (std::uint64_t id = 1; id < 400; ++id) {
    const Keyframe added = keyframe(id, 20 * random.gaussian_vector());
    if (kept.size() == kCapacity) {
      const std::size_t index = newer_of_the_most_similar(kept, kCapacity - kProtected);
      kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(index));
    }
    kept.push_back(added);
    database.add(added);
    ASSERT_EQ(database.keyframes().size(), kept.size());
    for (std::size_t i = 0; i < kept.size(); ++i) {
      ASSERT_EQ(database.keyframes()[i].pose.keyframe_id, kept[i].pose.keyframe_id) << id;
    }
  }
}

TEST(KeyframeDatabase, ANewKeyframeRefinesThoseBeforeIt) {
  const Eigen::Vector3d p(10, 1, 0.5);
  Keyframe older = keyframe(1, {0, 0, 0}), newer = keyframe(2, {2, 0, 0});
  older.features = {feature(3, p, older, 0.2)};
  newer.features = {feature(3, p, newer, 0.02)};
  KeyframeDatabase database({30, 20});
  database.add(older);
  database.add(newer);
  EXPECT_LT(database.find(1)->features[0].inverse_depth_sigma, 0.003);
}

TEST(KeyframeDatabase, RefusesACapacityThatLeavesNoChoice) {
  EXPECT_THROW(KeyframeDatabase({21, 20}), std::runtime_error);
}

}  // namespace
}  // namespace covey
