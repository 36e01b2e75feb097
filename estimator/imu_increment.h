// SPDX-License-Identifier: Apache-2.0
//
// IMU samples between two instants, summed into one relative motion with its covariance and its
// derivatives by the biases (Forster et al., "On-Manifold Preintegration", TRO 2017, sections
// V-VI).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "estimator/config.h"
#include "estimator/measurements.h"

namespace covey {

// With R, v, p the state at the start and dt the duration, the state at the end is
//   R' = R * rotation,  v' = v + g dt + R * velocity,  p' = p + v dt + g dt^2/2 + R * position.
struct ImuIncrement {
  double duration_s = 0;
  Eigen::Quaterniond rotation = Eigen::Quaterniond::Identity();
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();  // m/s, in the starting imu frame
  Eigen::Vector3d position = Eigen::Vector3d::Zero();  // m, in the starting imu frame
  // d(rotation, local), d(velocity), d(position) by the biases.
  Eigen::Matrix3d J_rotation_gyro_bias = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d J_velocity_gyro_bias = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d J_velocity_accel_bias = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d J_position_gyro_bias = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d J_position_accel_bias = Eigen::Matrix3d::Zero();
  // Of [position velocity rotation], from the white noise of gyro and accelerometer.
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();
};

// What is known of the motion between two instants.
struct ImuInterval {
  // At least two, in time order; the first and the last bound the interval, and may be interpolated
  // or held. Between two samples rate and specific force are taken as linear in time.
  std::vector<ImuSample> samples;
  // s, between the measured samples around the first and the last step, where those lie outside.
  double first_span_s = 0, last_span_s = 0;
};

// Where measured samples lie farther apart than noise.max_gap_s the motion between them wanders. An
// image may fall into such a gap: each part of it gets its share of what the whole adds, which is
// more than it alone would have, since the parts are taken for independent of each other.
[[nodiscard]] ImuIncrement integrate_imu(const ImuInterval& interval,
                                         const Eigen::Vector3d& gyro_bias,
                                         const Eigen::Vector3d& accel_bias, const ImuNoise& noise);

// The sample at `stamp_ns`, linear between two neighbours.
[[nodiscard]] ImuSample interpolate(const ImuSample& before, const ImuSample& after,
                                    TimeNs stamp_ns);

}  // namespace covey
