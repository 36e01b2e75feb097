// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>

namespace covey {

// Where a camera looks from, how far, and how sure that is.
struct CameraView {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  double mean_depth = 1;  // m
  double sigma = 0;       // of the position over the depth, plus of the attitude [rad]
};

// By how much two views differ, in rad: the way between them over their depth, plus the angle.
[[nodiscard]] inline double view_difference(const CameraView& a, const CameraView& b) {
  const double way = (a.T_world_cam.translation() - b.T_world_cam.translation()).norm();
  const Eigen::Matrix3d R_a_b = a.T_world_cam.linear().transpose() * b.T_world_cam.linear();
  return 2 * way / (a.mean_depth + b.mean_depth) + Eigen::AngleAxisd(R_a_b).angle();
}

}  // namespace covey
