// SPDX-License-Identifier: Apache-2.0
//
// What one matched landmark says of the pose between two keyframes.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "estimator/measurements.h"

namespace covey {

// Residual of the own bearing (x/z, y/z) and of the own inverse depth (1/m), its covariance, and
// how what is expected changes with [dp dtheta dlog_ratio]: T_other_own's translation (m), its
// rotation R <- Exp(dtheta) R, the logarithm of measured over expected own inverse depth. Without
// an own depth its row says nothing. The covariance is that of the bearing, the own depth and the
// other's depth.
struct MatchRow {
  bool in_front = false;
  Eigen::Vector3d r = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
  Eigen::Matrix<double, 3, 7> J = Eigen::Matrix<double, 3, 7>::Zero();
};

[[nodiscard]] MatchRow match_row(const Eigen::Isometry3d& T_other_own, double log_ratio,
                                 const LandmarkMatch& match);

}  // namespace covey
