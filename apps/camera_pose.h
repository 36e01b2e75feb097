// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>

#include "estimator/config.h"
#include "estimator/measurements.h"

namespace covey {

[[nodiscard]] inline Eigen::Isometry3d camera_in_world(const Pose& T_world_imu,
                                                       const CameraExtrinsics& extrinsics) {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  T_world_cam.linear() = (T_world_imu.q_world_imu * extrinsics.q_imu_cam).toRotationMatrix();
  T_world_cam.translation() =
      T_world_imu.p_world_imu + T_world_imu.q_world_imu * extrinsics.p_imu_cam;
  return T_world_cam;
}

}  // namespace covey
