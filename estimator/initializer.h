// SPDX-License-Identifier: Apache-2.0
//
// Where a drone that stands still starts: gravity gives roll and pitch, the gyro shows its bias.
#pragma once

#include <string>
#include <variant>
#include <vector>

#include "estimator/estimator.h"

namespace covey {

struct StaticInitConfig {
  double window_s = 0.5;             // s of IMU samples that must be still, twenty of them or more
  double max_gyro_deviation = 0.05;  // rad/s, standard deviation over the window
  double max_accel_deviation = 0.6;  // m/s2, the same
  double max_gyro_bias = 0.3;        // rad/s: a steady rotation faster than this is no bias
  double gravity = 9.81;             // m/s2
  double max_gravity_error = 1.0;    // m/s2, mean specific force against gravity
};

// Why not yet.
struct NotStill {
  std::string reason;
};

// From the last `window_s` of samples. Position and heading (rad) are unobservable: as given.
// Accelerometer bias starts at zero with its sigma.
[[nodiscard]] std::variant<InitialState, NotStill> static_initialization(
    const std::vector<ImuSample>& samples, const Eigen::Vector3d& p_world_imu, double heading,
    const StaticInitConfig& config);

// Where the IMU's x axis points, rad about the world's z axis; its z axis, where x points up or
// down (as EuRoC's does), within 45 degrees.
[[nodiscard]] double heading_of(const Eigen::Quaterniond& q_world_imu);

// Of the rotation about the world's z axis that takes `from` nearest to `to`, rad.
[[nodiscard]] double yaw_between(const Eigen::Quaterniond& from_world_imu,
                                 const Eigen::Quaterniond& to_world_imu);

[[nodiscard]] Eigen::Quaterniond turned_about_z(double yaw, const Eigen::Quaterniond& q_world_imu);

}  // namespace covey
