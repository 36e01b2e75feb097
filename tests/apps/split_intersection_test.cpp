// SPDX-License-Identifier: Apache-2.0
#include "apps/split_intersection.h"

#include <gtest/gtest.h>

namespace covey {
namespace {

constexpr double kOwnSigma = 0.1, kPeerSigma = 0.02, kBetween_m = 2;  // m, also rad / 10

Matrix6d of_sigma(double sigma) {
  Matrix6d P = Matrix6d::Zero();
  P.diagonal().head<3>().setConstant(sigma * sigma);
  P.diagonal().tail<3>().setConstant(sigma * sigma / 100);
  return P;
}

KeyframePose keyframe(double x, double sigma) {
  KeyframePose pose;
  pose.keyframe_id = 7;
  pose.stamp_ns = nanoseconds(1);
  pose.T_world_cam.translation().x() = x;
  pose.covariance = of_sigma(sigma);
  return pose;
}

// The own camera is `drift` further along x than its odometry says.
RelativePose seen_from_peer(double drift) {
  RelativePose relative;
  relative.own = keyframe(kBetween_m, kOwnSigma);
  relative.other = relative.other_before = keyframe(0, kPeerSigma);
  relative.T_other_own.translation().x() = kBetween_m + drift;
  relative.covariance = of_sigma(0.001);
  return relative;
}

SplitIntersection drone() {
  SplitIntersection fusion;
  fusion.add_own(keyframe(kBetween_m, kOwnSigma));
  return fusion;
}

TEST(SplitIntersection, APeerThatIsMuchSurerIsBelieved) {
  SplitIntersection fusion = drone();
  ASSERT_TRUE(fusion.fuse(seen_from_peer(0.05), {Vector6d::Zero(), of_sigma(kPeerSigma)}));
  const DriftEstimate drift = fusion.at(7).value();
  EXPECT_NEAR(drift.mean.x(), 0.05, 0.005);
  EXPECT_LT(drift.covariance.trace(), 0.3 * of_sigma(kOwnSigma).trace());
}

TEST(SplitIntersection, HoweverOftenAPeerSaysItNobodyGetsSurerThanThePeer) {
  SplitIntersection fusion = drone();
  const DriftEstimate peer{Vector6d::Zero(), of_sigma(kPeerSigma)};
  for (int i = 0; i < 100; ++i) fusion.fuse(seen_from_peer(0.01), peer);
  EXPECT_GT(fusion.at(7).value().covariance.determinant(), 0.99 * peer.covariance.determinant());
}

TEST(SplitIntersection, AnEqualOfUnknownCorrelationAddsLittle) {
  SplitIntersection fusion = drone();
  (void)fusion.fuse(seen_from_peer(0), {Vector6d::Zero(), of_sigma(kOwnSigma)});
  EXPECT_GT(fusion.at(7).value().covariance.determinant(), 0.5 * of_sigma(kOwnSigma).determinant());
}

TEST(SplitIntersection, BeyondTheGateNothingChanges) {
  SplitIntersection fusion = drone();
  EXPECT_FALSE(fusion.fuse(seen_from_peer(5), {Vector6d::Zero(), of_sigma(kPeerSigma)}));
  EXPECT_EQ(fusion.at(7).value().mean, Vector6d::Zero());
}

TEST(SplitIntersection, TheOutputIsTheOdometryWithoutItsDrift) {
  SplitIntersection fusion = drone();
  ASSERT_TRUE(fusion.fuse(seen_from_peer(0.05), {Vector6d::Zero(), of_sigma(kPeerSigma)}));
  Odometry alone;
  alone.stamp_ns = nanoseconds(1);
  alone.pose.p_world_imu.x() = kBetween_m;
  alone.pose_covariance = of_sigma(kOwnSigma);
  EXPECT_NEAR(fusion.corrected(alone).pose.p_world_imu.x(), kBetween_m + 0.05, 0.005);
}

}  // namespace
}  // namespace covey
