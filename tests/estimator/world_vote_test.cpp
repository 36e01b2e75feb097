// SPDX-License-Identifier: Apache-2.0
#include "estimator/world_vote.h"

#include <gtest/gtest.h>

#include "estimator/so3.h"

namespace covey {
namespace {

constexpr double kDepth_m = 4;  // as in a room

// The peer's world is turned about gravity and moved.
Eigen::Isometry3d true_world() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = exp_so3({0, 0, 0.7});
  T.translation() = Eigen::Vector3d(5, -3, 0.4);
  return T;
}

// The own camera at (0, y), turned by `angle` about gravity, and a peer's in the same place; the
// peer's world lies as `T_own_peer` has it.
RelativePose seen_from(double y, double angle, std::uint64_t keyframe,
                       const Eigen::Isometry3d& T_own_peer = true_world()) {
  RelativePose pose;
  pose.drone = "uav1";
  pose.own.keyframe_id = pose.other.keyframe_id = keyframe;
  pose.own.T_world_cam.linear() = exp_so3({0, 0, angle});
  pose.own.T_world_cam.translation() = Eigen::Vector3d(0, y, 1);
  pose.own_mean_depth = kDepth_m;
  pose.other.T_world_cam = T_own_peer.inverse() * pose.own.T_world_cam;
  return pose;
}

// How many agree in the end, of views so far apart.
std::size_t believed(double way_m, double angle, double depth_m = kDepth_m) {
  WorldVote vote;
  std::size_t agreeing = 0;
  for (std::uint64_t i = 0; i < 4; ++i) {
    const double share = static_cast<double>(i) / 3;
    RelativePose pose = seen_from(share * way_m, share * angle, i + 1);
    pose.own_mean_depth = depth_m;
    agreeing = vote.add({}, pose).size();
  }
  return agreeing;
}

TEST(WorldVote, IsWonByViewsThatDiffer) {
  EXPECT_EQ(believed(1.8, 0), 4u) << "0.45 of the depth";
  EXPECT_EQ(believed(0, 0.45), 4u) << "turned on the spot";
  EXPECT_EQ(believed(1.0, 0.2), 4u) << "both";
  EXPECT_EQ(believed(1.0, 0.1), 0u) << "which all show nearly the same";
  EXPECT_EQ(believed(1.8, 0, 10 * kDepth_m), 0u) << "of a landscape";
}

TEST(WorldVote, NeedsDifferentKeyframesOfBoth) {
  for (const bool of_peer : {false, true}) {
    WorldVote vote;
    for (std::uint64_t i = 0; i < 8; ++i) {
      RelativePose pose = seen_from(static_cast<double>(i), 0, i + 1);
      (of_peer ? pose.other : pose.own).keyframe_id = 1 + i % 3;
      EXPECT_TRUE(vote.add({}, pose).empty());
    }
  }
}

TEST(WorldVote, IsLostWhereMostSayOtherwise) {
  WorldVote vote;
  for (std::uint64_t i = 0; i < 4; ++i) {
    Eigen::Isometry3d elsewhere = true_world();
    elsewhere.translation().x() += 1 + static_cast<double>(i);  // each another world
    EXPECT_TRUE(vote.add({}, seen_from(static_cast<double>(i), 0, 11 + i, elsewhere)).empty());
  }
  std::size_t needed = 0;
  for (std::uint64_t i = 0; vote.add({}, seen_from(static_cast<double>(i), 0, 21 + i)).empty(); ++i)
    ASSERT_LT(++needed, 20u);
  EXPECT_EQ(needed, 5u) << "six of ten are the share that must agree";
}

TEST(WorldVote, BeginsAnewOnceWon) {
  WorldVote vote;
  for (std::uint64_t i = 0; i < 4; ++i) {
    EXPECT_EQ(vote.add({}, seen_from(static_cast<double>(i), 0, i + 1)).size(), i == 3 ? 4u : 0u);
  }
  EXPECT_TRUE(vote.add({}, seen_from(4, 0, 5)).empty());
}

TEST(World, IsLevelAndWhereTheRelativePoseHasIt) {
  const RelativePose pose = seen_from(2, 0.3, 1);
  EXPECT_TRUE(world_of(pose).isApprox(true_world(), 1e-12));
  Eigen::Isometry3d tilted = true_world();
  tilted.linear() = exp_so3({0.02, -0.01, 0}) * tilted.linear();
  const Eigen::Vector3d p_peer(1, 2, 3);
  const Eigen::Isometry3d level = levelled(tilted, p_peer);
  EXPECT_TRUE((level.linear() * Eigen::Vector3d::UnitZ()).isApprox(Eigen::Vector3d::UnitZ()));
  EXPECT_TRUE((level * p_peer).isApprox(tilted * p_peer));
}

}  // namespace
}  // namespace covey
