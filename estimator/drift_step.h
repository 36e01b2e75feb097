// SPDX-License-Identifier: Apache-2.0
//
// How the error of a drone's odometry goes on from one keyframe to the next. Errors are [dp
// dtheta], world axes, R = Exp(dtheta) R^.
#pragma once

#include "estimator/measurements.h"

namespace covey {

using Vector6d = Eigen::Matrix<double, 6, 1>;

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

// The odometry's output with the drift taken out that it had at `from`, where it said `P_from` of
// its error: in truth that was `drift` with covariance `P_drift`.
[[nodiscard]] Odometry without_drift(const Odometry& alone, const Eigen::Vector3d& from,
                                     const Matrix6d& P_from, const Vector6d& drift,
                                     const Matrix6d& P_drift);

}  // namespace covey
