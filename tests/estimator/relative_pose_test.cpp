// SPDX-License-Identifier: Apache-2.0
#include "estimator/relative_pose.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <optional>

#include "estimator/so3.h"
#include "sim/random.h"

namespace covey {
namespace {

constexpr double kSigma = 0.3 / 455;
constexpr double kDepthShare = 0.02;
constexpr double kDepth_m = 10;  // mean

Eigen::Isometry3d true_pose() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = exp_so3({0.05, -0.2, 0.03});
  T.translation() = Eigen::Vector3d(1.5, -0.2, 0.8);
  return T;
}

// Landmarks 5..20 m in front of the other camera, whose depths and the own bearings are disturbed.
// The other drone has measured them on a way of 5 m.
// With a log ratio the own drone has measured their depths too, all of them too small by it.
KeyframeMatch make_match(std::uint64_t seed, int landmarks, double noise = 1,
                         std::optional<double> log_ratio = std::nullopt) {
  Random random(seed, 0x3e1a), random_of_own(seed, 0x0d37);
  KeyframeMatch match;
  match.drone = "uav1";
  match.other.T_world_cam.translation().x() = 5;
  match.T_other_own = true_pose();
  match.T_other_own.translation() += Eigen::Vector3d(0.2, -0.1, 0.3);
  match.T_other_own.linear() = exp_so3({0.02, 0.03, -0.01}) * true_pose().linear();
  for (int i = 0; i < landmarks; ++i) {
    const Eigen::Vector2d bearing(random.uniform(-0.6, 0.6), random.uniform(-0.4, 0.4));
    const double depth = random.uniform(5, 20);
    const Eigen::Vector3d p_own = true_pose().inverse() * (depth * bearing.homogeneous()).eval();
    LandmarkMatch landmark;
    landmark.other_bearing = bearing;
    landmark.bearing = p_own.hnormalized() +
                       noise * kSigma * Eigen::Vector2d(random.gaussian(), random.gaussian());
    landmark.inverse_depth = (1 + noise * kDepthShare * random.gaussian()) / depth;
    landmark.inverse_depth_sigma = kDepthShare / depth;
    landmark.bearing_covariance = kSigma * kSigma * Eigen::Matrix2d::Identity();
    if (log_ratio) {
      landmark.own_inverse_depth =
          std::exp(*log_ratio) / p_own.z() * (1 + noise * kDepthShare * random_of_own.gaussian());
      landmark.own_inverse_depth_sigma = kDepthShare / p_own.z();
    }
    match.matches.push_back(landmark);
  }
  return match;
}

Eigen::Matrix<double, 6, 1> error_of(const RelativePose& pose) {
  Eigen::Matrix<double, 6, 1> error;
  error << true_pose().translation() - pose.T_other_own.translation(),
      log_so3(true_pose().linear() * pose.T_other_own.linear().transpose());
  return error;
}

// Six degrees of freedom.
double nees_of(const RelativePose& pose) {
  return error_of(pose).dot(pose.covariance.llt().solve(error_of(pose)));
}

TEST(RelativePose, WithoutNoiseItIsExact) {
  const auto pose = estimate_relative_pose(make_match(1, 12, 0), 8);
  ASSERT_TRUE(pose);
  EXPECT_LT(error_of(*pose).norm(), 1e-6);
  EXPECT_EQ(pose->inliers, 12);
  EXPECT_EQ(pose->drone, "uav1");
}

TEST(RelativePose, ErrorsAreAsLargeAsTheCovarianceSays) {
  double nees = 0;
  constexpr int kRuns = 300;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    const auto pose = estimate_relative_pose(make_match(seed, 30), 8);
    ASSERT_TRUE(pose);
    nees += nees_of(*pose);
  }
  EXPECT_NEAR(nees / kRuns, 6.0, 1.0);
}

// All depths wrong by the same 2 %, and each by 1 % of its own.
KeyframeMatch with_shared_depth_error(std::uint64_t seed) {
  constexpr double kShared = 0.02, kEach = 0.01;
  Random random(seed, 0x5ba2);
  const double shared = kShared * random.gaussian();
  KeyframeMatch match = make_match(seed, 30);
  for (LandmarkMatch& landmark : match.matches) {
    const double true_inverse_depth = landmark.inverse_depth_sigma / kDepthShare;
    landmark.inverse_depth = true_inverse_depth * (1 + shared + kEach * random.gaussian());
    landmark.inverse_depth_sigma = std::hypot(kShared, kEach) * true_inverse_depth;
  }
  return match;
}

TEST(RelativePose, DepthsOfWhoHasHardlyMovedMayAllBeWrongAlike) {
  double nees = 0, nees_on_a_way = 0;
  constexpr int kRuns = 300;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    KeyframeMatch match = with_shared_depth_error(seed);
    const auto on_a_way = estimate_relative_pose(match, 8);
    match.other_before = match.other;
    const auto on_the_spot = estimate_relative_pose(match, 8);
    ASSERT_TRUE(on_a_way && on_the_spot);
    nees += nees_of(*on_the_spot);
    nees_on_a_way += nees_of(*on_a_way);
    EXPECT_TRUE(on_the_spot->T_other_own.isApprox(on_a_way->T_other_own, 0));
  }
  EXPECT_NEAR(nees / kRuns, 6.0, 1.5);
  EXPECT_GT(nees_on_a_way / kRuns, 12.0) << "there the way tells it, and counts it once";
}

TEST(RelativePose, TwoDronesDepthsTellTheRatioOfTheirScales) {
  constexpr double kLogRatio = 0.03;
  const auto exact = estimate_relative_pose(make_match(1, 12, 0, kLogRatio), 8);
  ASSERT_TRUE(exact && exact->depth_ratio);
  EXPECT_NEAR(exact->depth_ratio->log_ratio, kLogRatio, 1e-5);
  EXPECT_LT(error_of(*exact).norm(), 1e-5) << "the pose is in the other's scale";
  EXPECT_FALSE(estimate_relative_pose(make_match(1, 12, 0), 8)->depth_ratio) << "none measured";
}

TEST(RelativePose, PoseAndRatioTogetherAreAsUncertainAsTheirCovarianceSays) {
  constexpr double kLogRatio = -0.01;
  double nees = 0;
  constexpr int kRuns = 300;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    const auto pose = estimate_relative_pose(make_match(seed, 30, 1, kLogRatio), 8);
    ASSERT_TRUE(pose && pose->depth_ratio);
    Eigen::Matrix<double, 7, 7> P;
    P << pose->covariance, pose->depth_ratio->covariance_with_pose,
        pose->depth_ratio->covariance_with_pose.transpose(), pose->depth_ratio->variance;
    Eigen::Matrix<double, 7, 1> error;
    error << error_of(*pose), kLogRatio - pose->depth_ratio->log_ratio;
    nees += error.dot(P.llt().solve(error));
  }
  EXPECT_NEAR(nees / kRuns, 7.0, 1.0);
}

KeyframePose keyframe(std::uint64_t id) {
  KeyframePose pose;
  pose.keyframe_id = id;
  pose.T_world_cam.translation() = Eigen::Vector3d(static_cast<double>(id), 0, 2);
  return pose;
}

// A message from uav1, whose camera has found this drone's keyframe 5.
PeerKeyframe told_by_uav1(const RelativePose& found) {
  RelativePose as_uav1_has_it = found;
  as_uav1_has_it.drone = "uav0";
  as_uav1_has_it.own = keyframe(8);
  as_uav1_has_it.own_before = keyframe(2);
  as_uav1_has_it.other = keyframe(5);
  return as_told(as_uav1_has_it, "uav1");
}

TEST(RelativePose, ToldToTheOtherDroneItIsTheSameSeenFromThere) {
  constexpr double kLogRatio = 0.03;
  const auto found = estimate_relative_pose(make_match(1, 12, 0, kLogRatio), 8);
  ASSERT_TRUE(found && found->depth_ratio);
  const PeerKeyframe message = told_by_uav1(*found);
  EXPECT_EQ(message.sender, "uav1");
  EXPECT_EQ(message.receiver, "uav0");
  ASSERT_TRUE(message.found);
  EXPECT_EQ(message.found->keyframe_id, 5u);
  const RelativePose mirrored = found_by_peer(message, keyframe(5), keyframe(4), kDepth_m);
  EXPECT_TRUE(mirrored.found_by_other);
  EXPECT_EQ(mirrored.drone, "uav1");
  EXPECT_EQ(mirrored.own.keyframe_id, 5u);
  EXPECT_EQ(mirrored.own_before.keyframe_id, 4u);
  EXPECT_EQ(mirrored.other.keyframe_id, 8u);
  EXPECT_EQ(mirrored.other_before.keyframe_id, 2u);
  EXPECT_TRUE(mirrored.T_other_own.isApprox(found->T_other_own.inverse(), 1e-9));
  ASSERT_TRUE(mirrored.depth_ratio);
  EXPECT_NEAR(mirrored.depth_ratio->log_ratio, -found->depth_ratio->log_ratio, 1e-12);
  EXPECT_NEAR(mirrored.depth_ratio->variance, found->depth_ratio->variance, 1e-15);

  const auto without = estimate_relative_pose(make_match(1, 12, 0), 8);
  ASSERT_TRUE(without);
  const PeerKeyframe told = told_by_uav1(*without);
  EXPECT_EQ(told.before.keyframe_id, told.pose.keyframe_id) << "its own depths tell nothing";
  EXPECT_FALSE(found_by_peer(told, keyframe(5), keyframe(4), kDepth_m).depth_ratio);
}

TEST(RelativePose, ItsCovarianceSeenFromTheOtherSideIsThatOfErrorsSeenFromThere) {
  const auto found = estimate_relative_pose(make_match(1, 30, 1, 0.01), 8);
  ASSERT_TRUE(found && found->depth_ratio);
  const RelativePose mirrored =
      found_by_peer(told_by_uav1(*found), keyframe(5), keyframe(4), kDepth_m);
  constexpr double kStep = 1e-6;
  Matrix7d J = Matrix7d::Zero();  // d(error seen from there) / d(error)
  for (int i = 0; i < 6; ++i) {
    const Vector6d step = kStep * Vector6d::Unit(i);
    Eigen::Isometry3d T = found->T_other_own;
    T.translation() += step.head<3>();
    T.linear() = exp_so3(Eigen::Vector3d(step.tail<3>())) * T.linear();
    const Eigen::Isometry3d from_there = T.inverse();
    J.col(i).head<3>() = (from_there.translation() - mirrored.T_other_own.translation()) / kStep;
    J.col(i).segment<3>(3) =
        log_so3(from_there.linear() * mirrored.T_other_own.linear().transpose()) / kStep;
  }
  J(6, 6) = -1;
  const Matrix7d P = told_by_uav1(*found).found->covariance;
  const Matrix7d expected = J * P * J.transpose();
  EXPECT_TRUE(mirrored.covariance.isApprox(expected.topLeftCorner<6, 6>(), 1e-4));
  EXPECT_TRUE(
      mirrored.depth_ratio->covariance_with_pose.isApprox(expected.topRightCorner<6, 1>(), 1e-4));
}

// As in flights: most lie within a third of the sigma, one in five far off.
TEST(RelativePose, AFewThatWereFoundBadlyCostLittle) {
  double with_tail = 0, without = 0, nees = 0;
  constexpr int kRuns = 100;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    Random random(seed, 0x7a11);
    KeyframeMatch match = make_match(seed, 60, 0);
    for (LandmarkMatch& one : match.matches) {
      const double share = random.uniform(0, 1) < 0.2 ? 1.5 : 0.33;
      one.bearing += share * kSigma * Eigen::Vector2d(random.gaussian(), random.gaussian());
    }
    match.aligned = match.matches;
    const auto found = estimate_relative_pose(match, 8);
    match.aligned.clear();
    const auto corners = estimate_relative_pose(match, 8);
    ASSERT_TRUE(found && corners);
    with_tail += error_of(*found).head<3>().squaredNorm();
    without += error_of(*corners).head<3>().squaredNorm();
    nees += nees_of(*found);
  }
  EXPECT_LT(with_tail, 0.7 * without);
  EXPECT_LT(nees / kRuns, 6.0);
}

// Each is known well along one direction and badly along the other.
TEST(RelativePose, WhatIsFoundWellCountsMore) {
  double told = 0, untold = 0, nees = 0;
  constexpr int kRuns = 100;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    Random random(seed, 0x5ca1);
    KeyframeMatch match = make_match(seed, 60, 0);
    for (LandmarkMatch& one : match.matches) {
      const Eigen::Rotation2Dd R(random.uniform(0, 3.14));
      const Eigen::Matrix2d root =
          kSigma * R.toRotationMatrix() * Eigen::Vector2d(0.3, 3).asDiagonal();
      one.bearing += root * Eigen::Vector2d(random.gaussian(), random.gaussian());
      one.bearing_covariance = root * root.transpose();
      one.inverse_depth_sigma *= 0.01;  // as exact as they are here
    }
    const auto pose = estimate_relative_pose(match, 8);
    for (LandmarkMatch& one : match.matches) {
      one.bearing_covariance =
          one.bearing_covariance.trace() / 2 * Eigen::Matrix2d::Identity().eval();
    }
    const auto alike = estimate_relative_pose(match, 8);
    ASSERT_TRUE(pose && alike);
    told += error_of(*pose).squaredNorm();
    untold += error_of(*alike).squaredNorm();
    nees += nees_of(*pose);
  }
  EXPECT_LT(told, 0.5 * untold);
  EXPECT_LT(nees / kRuns, 6.6);
}

TEST(RelativePose, WrongMatchesPullLittle) {
  KeyframeMatch match = make_match(5, 30);
  for (std::size_t i = 0; i < 6; ++i) match.matches[i].bearing += Eigen::Vector2d(0.05, -0.03);
  const auto pose = estimate_relative_pose(match, 8);
  ASSERT_TRUE(pose);
  EXPECT_LT(error_of(*pose).head<3>().norm(), 0.06);
  EXPECT_LE(pose->inliers, 26);
}

TEST(RelativePose, WhatWasFoundInTheImageCountsMoreThanTheCorners) {
  KeyframeMatch match = make_match(6, 30);
  match.aligned = match.matches;
  for (LandmarkMatch& corner : match.matches) corner.bearing.x() += 0.02;
  const auto pose = estimate_relative_pose(match, 8);
  ASSERT_TRUE(pose);
  EXPECT_LT(error_of(*pose).head<3>().norm(), 0.05);
  match.aligned.resize(7);
  EXPECT_GT(error_of(*estimate_relative_pose(match, 8)).norm(), 0.015) << "too few: the corners";
}

TEST(RelativePose, TooFewOrAllOnOneSpotFixNothing) {
  EXPECT_FALSE(estimate_relative_pose(make_match(7, 7), 8));
  KeyframeMatch spot = make_match(8, 1, 0);
  spot.T_other_own = true_pose();
  spot.matches.resize(20, spot.matches.front());
  EXPECT_FALSE(estimate_relative_pose(spot, 8));
}

}  // namespace
}  // namespace covey
