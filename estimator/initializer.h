// SPDX-License-Identifier: Apache-2.0
//
// Where a drone that stands still starts: gravity gives roll and pitch, the gyro shows its bias.
#pragma once

#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "estimator/estimator.h"

namespace covey {

struct StaticInitConfig {
  double window_s = 0.5;             // s of IMU samples that must be still
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

// From the last `window_s` of samples. Position and yaw are unobservable: taken from `position` and
// `yaw` (rad). Accelerometer bias starts at zero with its sigma.
[[nodiscard]] std::variant<InitialState, NotStill> static_initialization(
    const std::vector<ImuSample>& samples, const Eigen::Vector3d& p_world_imu, double yaw,
    const StaticInitConfig& config);

// Rotation about the world's z axis, rad.
[[nodiscard]] double yaw_of(const Eigen::Quaterniond& q_world_imu);

}  // namespace covey
