// SPDX-License-Identifier: Apache-2.0
//
// Trajectories on disk: TUM text (t x y z qx qy qz qw, seconds) and EuRoC csv (ns, position,
// w-x-y-z quaternion), told apart by content; and the covariances that go with an estimate.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

struct StampedPose {
  TimeNs stamp_ns = 0;
  Pose pose;
};

using StampedPoses = std::vector<StampedPose>;  // stamps strictly increasing

// Across longer holes of a ground truth nothing is interpolated: who knows what was flown there.
inline constexpr double kLongestTruthGap_s = 0.5;

// Of [dp dtheta]: dp in world (m), dtheta local (rad), as Odometry::pose_covariance.
struct StampedCovariance {
  TimeNs stamp_ns = 0;
  Matrix6d covariance = Matrix6d::Zero();
};

// Throws std::runtime_error with file and line on anything that is not a trajectory.
[[nodiscard]] StampedPoses read_trajectory(const std::filesystem::path& file);
[[nodiscard]] std::vector<StampedCovariance> read_covariances(const std::filesystem::path& file);

inline constexpr char kTumHeader[] = "# t[s] x[m] y[m] z[m] qx qy qz qw";
inline constexpr char kCovarianceHeader[] =
    "#stamp_ns, upper triangle of the covariance of [dp_world dtheta_imu], row by row [m, rad]";

// One line of such a file, without its end.
[[nodiscard]] std::string tum_line(const StampedPose& pose);
[[nodiscard]] std::string covariance_line(const StampedCovariance& sample);

void write_tum(const std::filesystem::path& file, const StampedPoses& trajectory);

}  // namespace covey
