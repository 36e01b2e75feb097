// SPDX-License-Identifier: Apache-2.0
//
// How the error of a drone's odometry goes on from one keyframe to the next. Errors are [dp
// dtheta], world axes, R = Exp(dtheta) R^.
#pragma once

#include <Eigen/Geometry>

#include "estimator/measurements.h"

namespace covey {

// How the error at `from` shows at `to`, m: yaw turns what comes after it; tilt is kept by gravity
// and does not.
[[nodiscard]] Matrix6d drift_lever(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

// e_to = A e_from + w, cov(w) = Q.
struct DriftStep {
  Matrix6d A = Matrix6d::Zero();
  Matrix6d Q = Matrix6d::Identity();
};

// From what odometry says of its errors at both ends.
[[nodiscard]] DriftStep drift_step(const Eigen::Vector3d& from, const Matrix6d& P_from,
                                   const Eigen::Vector3d& to, const Matrix6d& P_to);

// Is the way from -> to long enough for landmarks' depths to have been measured over it?
[[nodiscard]] bool is_depth_baseline(const Eigen::Vector3d& from, const Eigen::Vector3d& to);

// How the share by which odometry has the way from -> to too short changes with the position error
// at `to`: landmarks' depths that were measured over it, and with them the way between two cameras,
// are too short by it. Nothing where no depths are measured over it.
[[nodiscard]] Eigen::RowVector3d scale_gradient(const Eigen::Vector3d& from,
                                                const Eigen::Vector3d& to);

[[nodiscard]] Matrix6d rotated(const Matrix6d& covariance, const Eigen::Matrix3d& R);

// What a relative pose says of the error at the own camera, less that at the other one; `b`, m,
// from the other one to the own.
[[nodiscard]] Vector6d relative_residual(const Eigen::Isometry3d& T_other_own,
                                         const Eigen::Matrix3d& R_world_other,
                                         const Eigen::Matrix3d& R_world_own,
                                         const Eigen::Vector3d& b);

// The odometry's output with the drift taken out that it had at `from`, where it said `P_from` of
// its error: in truth that was `drift` with covariance `P_drift`.
[[nodiscard]] Odometry without_drift(const Odometry& alone, const Eigen::Vector3d& from,
                                     const Matrix6d& P_from, const Vector6d& drift,
                                     const Matrix6d& P_drift);

}  // namespace covey
