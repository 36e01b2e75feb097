// SPDX-License-Identifier: Apache-2.0
//
// Drones that fly straight and drift, and what they see of each other: for tests of the drift
// filter.
#pragma once

#include <Eigen/Eigenvalues>
#include <cstdint>
#include <string>
#include <vector>

#include "estimator/drift_filter.h"
#include "estimator/so3.h"
#include "sim/random.h"

namespace covey {

inline constexpr double kStep_m = 1.0;      // between two keyframes
inline constexpr double kDrift_m = 0.01;    // standard deviation that a step adds, per axis
inline constexpr double kDrift_rad = 5e-4;  // of yaw
inline constexpr double kTilt_rad = 1e-3;
inline constexpr double kDepth_m = 10;  // of what a keyframe sees

// A drone that flies straight and drifts at random, keyframe by keyframe.
struct Walk {
  std::vector<KeyframePose> keyframes;  // as its odometry has them
  std::vector<Eigen::Isometry3d> truth;
};

inline Walk walk(std::uint64_t seed, int keyframes, const Eigen::Vector3d& start) {
  Random random(seed, 0xd41f);
  Walk walk;
  Eigen::Vector3d drift = Eigen::Vector3d::Zero();
  const Eigen::Vector2d tilt(kTilt_rad * random.gaussian(), kTilt_rad * random.gaussian());
  double yaw = 0;
  Matrix6d P = Matrix6d::Zero(), F = Matrix6d::Identity();
  P.diagonal() << 1e-6, 1e-6, 1e-6, kTilt_rad * kTilt_rad, kTilt_rad * kTilt_rad, 1e-8;
  F.block<3, 1>(0, 5) = kStep_m * Eigen::Vector3d::UnitZ().cross(Eigen::Vector3d::UnitY());
  for (int i = 0; i < keyframes; ++i) {
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.linear() << 0, 0, 1, -1, 0, 0, 0, -1, 0;
    T.translation() = start + i * kStep_m * Eigen::Vector3d::UnitY();
    walk.truth.push_back(T);
    KeyframePose pose;
    pose.keyframe_id = static_cast<std::uint64_t>(i) + 1;
    pose.stamp_ns = nanoseconds(0.5 * i);
    const Eigen::Vector3d turn(tilt.x(), tilt.y(), yaw);
    pose.T_world_cam.linear() = exp_so3(Eigen::Vector3d(-turn)) * T.linear();
    pose.T_world_cam.translation() = T.translation() - drift;
    pose.covariance = P;
    walk.keyframes.push_back(pose);
    P = F * P * F.transpose();
    P.diagonal().head<3>().array() += kDrift_m * kDrift_m;
    P(5, 5) += kDrift_rad * kDrift_rad;
    drift += kDrift_m * random.gaussian_vector();
    drift += Eigen::Vector3d::UnitZ().cross(kStep_m * Eigen::Vector3d::UnitY()) * yaw;
    yaw += kDrift_rad * random.gaussian();
  }
  return walk;
}

inline RelativePose relative(const Walk& own, std::size_t i, const Walk& other, std::size_t j,
                             std::uint64_t seed, const std::string& name = "uav1") {
  Random random(seed, 0x4e1);
  RelativePose pose;
  pose.drone = name;
  pose.own = own.keyframes[i];
  pose.own_mean_depth = kDepth_m;
  pose.other = other.keyframes[j];
  pose.other_before = other.keyframes[j >= 6 ? j - 6 : 0];
  const Eigen::Isometry3d truth = other.truth[j].inverse() * own.truth[i];
  constexpr double kSigma_m = 0.01, kSigma_rad = 5e-4;
  pose.T_other_own.translation() = truth.translation() + kSigma_m * random.gaussian_vector();
  pose.T_other_own.linear() =
      exp_so3(Eigen::Vector3d(kSigma_rad * random.gaussian_vector())) * truth.linear();
  pose.covariance.setZero();
  pose.covariance.diagonal().head<3>().setConstant(kSigma_m * kSigma_m);
  pose.covariance.diagonal().tail<3>().setConstant(kSigma_rad * kSigma_rad);
  pose.inliers = 30;
  return pose;
}

inline Odometry odometry_at(const KeyframePose& pose) {
  Odometry odometry;
  odometry.stamp_ns = pose.stamp_ns;
  odometry.pose.p_world_imu = pose.T_world_cam.translation();
  odometry.pose.q_world_imu = Eigen::Quaterniond(pose.T_world_cam.linear());
  odometry.pose_covariance = pose.covariance;
  const Eigen::Matrix3d R = pose.T_world_cam.linear();
  odometry.pose_covariance.bottomRightCorner<3, 3>() =
      R.transpose() * pose.covariance.bottomRightCorner<3, 3>() * R;
  return odometry;
}

inline double least_eigenvalue(const DriftFilter& filter) {
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(filter.covariance())
      .eigenvalues()
      .minCoeff();
}

inline RelativePose five_metres_off(RelativePose pose) {
  pose.other.T_world_cam.translation().x() += 5;
  pose.other_before.T_world_cam.translation().x() += 5;
  return pose;
}

}  // namespace covey
