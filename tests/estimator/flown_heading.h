// SPDX-License-Identifier: Apache-2.0
//
// Motion made up for a test: a drone whose camera looks level, along its heading.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <functional>
#include <vector>

#include "sim/trajectory.h"

namespace covey {

struct Heading {
  Eigen::Vector3d p_world_imu = Eigen::Vector3d::Zero();  // m
  double yaw = 0;                                         // rad
};

inline Trajectory flown(const std::function<Heading(double time_s)>& motion, double duration_s) {
  constexpr double kStep_s = 0.02;
  Eigen::Matrix3d R_heading_imu;  // EuRoC's IMU: x up, the camera looks along z
  R_heading_imu << 0, 0, 1, 0, -1, 0, 1, 0, 0;
  std::vector<double> times_s;
  std::vector<Pose> poses;
  for (double t = 0; t < duration_s; t += kStep_s) {
    const Heading heading = motion(t);
    const Eigen::AngleAxisd turned(heading.yaw, Eigen::Vector3d::UnitZ());
    times_s.push_back(t);
    poses.push_back({heading.p_world_imu, Eigen::Quaterniond(turned * R_heading_imu)});
  }
  return Trajectory::from_poses(times_s, poses);
}

}  // namespace covey
