// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>

#include "estimator/config.h"
#include "estimator/measurements.h"
#include "estimator/so3.h"

namespace covey {

[[nodiscard]] inline Eigen::Isometry3d camera_in_world(const Pose& T_world_imu,
                                                       const CameraExtrinsics& extrinsics) {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  T_world_cam.linear() = (T_world_imu.q_world_imu * extrinsics.q_imu_cam).toRotationMatrix();
  T_world_cam.translation() =
      T_world_imu.p_world_imu + T_world_imu.q_world_imu * extrinsics.p_imu_cam;
  return T_world_cam;
}

// Of [dp dtheta] of the camera, both in world axes.
[[nodiscard]] inline Matrix6d camera_covariance(const Odometry& odometry,
                                                const CameraExtrinsics& extrinsics) {
  const Eigen::Matrix3d R = odometry.pose.q_world_imu.toRotationMatrix();
  Matrix6d J = Matrix6d::Identity();
  J.topRightCorner<3, 3>() = -R * skew(extrinsics.p_imu_cam);
  J.bottomRightCorner<3, 3>() = R;
  return J * odometry.pose_covariance * J.transpose();
}

}  // namespace covey
