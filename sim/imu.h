// SPDX-License-Identifier: Apache-2.0
//
// An inertial sensor: what it reads on a trajectory, with white noise and biases that walk.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "estimator/config.h"
#include "estimator/measurements.h"
#include "sim/trajectory.h"

namespace covey {

struct ImuSensor {
  ImuNoise noise;  // continuous-time densities
  double rate_hz = 200;
  double gyro_start_bias_sigma = 0.02;  // rad/s, of each axis
  double accel_start_bias_sigma = 0.1;  // m/s2, of each axis
  double gravity = 9.81;                // m/s2
};

[[nodiscard]] ImuSensor adis16448();
[[nodiscard]] ImuSensor icm20608();

struct ImuBias {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();   // rad/s
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();  // m/s2
};

struct ImuRecording {
  std::vector<ImuSample> samples;
  std::vector<ImuBias> biases;  // true ones, one for each sample

  // True bias at a stamp: of the last sample not after it (of the first when there is none).
  [[nodiscard]] const ImuBias& bias_at(TimeNs stamp_ns) const;
};

// Samples from the trajectory's start to its end, both included; a sample is the value at its
// stamp. `start_ns` is the stamp of the trajectory's time 0.
[[nodiscard]] ImuRecording simulate_imu(const Trajectory& trajectory, const ImuSensor& sensor,
                                        std::uint64_t seed, TimeNs start_ns = 0);

}  // namespace covey
