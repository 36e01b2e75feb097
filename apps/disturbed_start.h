// SPDX-License-Identifier: Apache-2.0
//
// How a simulated flight begins for the filter.
#pragma once

#include <cstdint>

#include "estimator/estimator.h"
#include "estimator/so3.h"
#include "sim/feature_simulation.h"
#include "sim/random.h"

namespace covey {

// The truth at time 0, disturbed by a draw from the covariance that the filter is told.
inline InitialState disturbed_start(const DroneFeatures& drone, const ImuBias& bias,
                                    std::uint64_t seed) {
  Random random(seed, 0x57a7);
  InitialState start;
  const KinematicState truth = drone.trajectory.at(0);
  start.stamp_ns = drone.imu.front().stamp_ns;
  const Eigen::Vector3d tilt_yaw(start.tilt_sigma, start.tilt_sigma, start.yaw_sigma);
  const Eigen::Vector3d turn_world = tilt_yaw.cwiseProduct(random.gaussian_vector());
  start.pose.p_world_imu = truth.pose.p_world_imu + start.position_sigma * random.gaussian_vector();
  start.pose.q_world_imu = exp_quaternion(turn_world) * truth.pose.q_world_imu;
  start.v_world_imu = truth.v_world_imu + start.velocity_sigma * random.gaussian_vector();
  start.gyro_bias = bias.gyro + start.gyro_bias_sigma * random.gaussian_vector();
  start.accel_bias = bias.accel + start.accel_bias_sigma * random.gaussian_vector();
  return start;
}

}  // namespace covey
