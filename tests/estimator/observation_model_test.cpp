// SPDX-License-Identifier: Apache-2.0
#include "estimator/observation_model.h"

#include <gtest/gtest.h>

#include "estimator/so3.h"
#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

const Pose kPose{{1.2, -0.4, 2.1}, exp_quaternion({0.3, -0.8, 1.1})};
const CameraExtrinsics kExtrinsics{exp_quaternion({-1.2, 0.9, 0.2}), {0.1, -0.05, 0.02}, 0};
const Eigen::Vector3d kInverseDepth(0.3, -0.2, 0.2);

Pose moved(const Pose& pose, const Vector6d& error) {
  return {pose.p_world_imu + error.head<3>(), pose.q_world_imu * exp_quaternion(error.tail<3>())};
}

CameraExtrinsics moved(const CameraExtrinsics& extrinsics, const Vector6d& error) {
  return {extrinsics.q_imu_cam * exp_quaternion(error.tail<3>()),
          extrinsics.p_imu_cam + error.head<3>(), extrinsics.time_offset_s};
}

Eigen::Vector3d point_in_front() {
  return anchored_point(kInverseDepth, kPose, kExtrinsics).p_world;
}

TEST(ObservationModel, BearingDerivativesAgreeWithDifferences) {
  const Eigen::Vector3d p = point_in_front();
  const PointObservation analytic = observe_point(p, kPose, kExtrinsics);
  ASSERT_TRUE(analytic.in_front);
  const auto by_pose = [&](const Vector6d& e) {
    return observe_point(p, moved(kPose, e), kExtrinsics).bearing;
  };
  const auto by_extrinsics = [&](const Vector6d& e) {
    return observe_point(p, kPose, moved(kExtrinsics, e)).bearing;
  };
  const auto by_point = [&](const Eigen::Vector3d& e) {
    return observe_point(p + e, kPose, kExtrinsics).bearing;
  };
  expect_jacobian("J_pose", analytic.J_pose, by_pose);
  expect_jacobian("J_extrinsics", analytic.J_extrinsics, by_extrinsics);
  expect_jacobian("J_point", analytic.J_point, by_point);
}

TEST(ObservationModel, AnchoredPointDerivativesAgreeWithDifferences) {
  const AnchoredPoint analytic = anchored_point(kInverseDepth, kPose, kExtrinsics);
  const auto by_anchor = [&](const Vector6d& e) {
    return anchored_point(kInverseDepth, moved(kPose, e), kExtrinsics).p_world;
  };
  const auto by_extrinsics = [&](const Vector6d& e) {
    return anchored_point(kInverseDepth, kPose, moved(kExtrinsics, e)).p_world;
  };
  const auto by_inverse_depth = [&](const Eigen::Vector3d& e) {
    return anchored_point(kInverseDepth + e, kPose, kExtrinsics).p_world;
  };
  expect_jacobian("J_anchor", analytic.J_anchor, by_anchor);
  expect_jacobian("J_extrinsics", analytic.J_extrinsics, by_extrinsics);
  expect_jacobian("J_inverse_depth", analytic.J_inverse_depth, by_inverse_depth);
}

TEST(ObservationModel, InverseDepthDerivativesAgreeWithDifferences) {
  const Eigen::Vector3d p = point_in_front();
  const InverseDepthOfPoint analytic = inverse_depth_of_point(p, kPose, kExtrinsics);
  const auto by_pose = [&](const Vector6d& e) {
    return inverse_depth_of_point(p, moved(kPose, e), kExtrinsics).inverse_depth;
  };
  const auto by_extrinsics = [&](const Vector6d& e) {
    return inverse_depth_of_point(p, kPose, moved(kExtrinsics, e)).inverse_depth;
  };
  const auto by_point = [&](const Eigen::Vector3d& e) {
    return inverse_depth_of_point(p + e, kPose, kExtrinsics).inverse_depth;
  };
  expect_jacobian("J_pose", analytic.J_pose, by_pose);
  expect_jacobian("J_extrinsics", analytic.J_extrinsics, by_extrinsics);
  expect_jacobian("J_point", analytic.J_point, by_point);
}

TEST(ObservationModel, AnchoredPointAndItsInverseUndoEachOther) {
  const InverseDepthOfPoint back = inverse_depth_of_point(point_in_front(), kPose, kExtrinsics);
  ASSERT_TRUE(back.in_front);
  EXPECT_LT((back.inverse_depth - kInverseDepth).norm(), 1e-12);
}

TEST(ObservationModel, WhitenedNoiseHasCovarianceOne) {
  Eigen::Matrix2d covariance;
  covariance << 4e-6, -1.5e-6, -1.5e-6, 1e-6;
  const Eigen::Matrix2d W = whitening(covariance);
  EXPECT_LT((W * covariance * W.transpose() - Eigen::Matrix2d::Identity()).norm(), 1e-9);
}

TEST(ObservationModel, PointBehindTheCameraIsNotSeen) {
  const CameraPose camera = camera_pose(kPose, kExtrinsics);
  const Eigen::Vector3d behind =
      camera.p_world_cam - camera.R_world_cam * Eigen::Vector3d(0.1, 0.1, 3);
  EXPECT_FALSE(observe_point(behind, kPose, kExtrinsics).in_front);
  EXPECT_FALSE(inverse_depth_of_point(behind, kPose, kExtrinsics).in_front);
}

}  // namespace
}  // namespace covey
