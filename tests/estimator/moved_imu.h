// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "estimator/so3.h"
#include "estimator/state.h"

namespace covey {

// By an error of the state; `dx` may be that of a whole one.
inline ImuState moved(ImuState imu, const Eigen::VectorXd& dx) {
  imu.pose.p_world_imu += dx.segment<3>(State::kPosition);
  imu.v_world_imu += dx.segment<3>(State::kVelocity);
  imu.pose.q_world_imu =
      imu.pose.q_world_imu * exp_quaternion(Eigen::Vector3d(dx.segment<3>(State::kRotation)));
  imu.gyro_bias += dx.segment<3>(State::kGyroBias);
  imu.accel_bias += dx.segment<3>(State::kAccelBias);
  return imu;
}

}  // namespace covey
