// SPDX-License-Identifier: Apache-2.0
//
// What a relative pose says of how far odometry has drifted by the keyframes on its both sides.
// Errors are [dp dtheta], world axes, R = Exp(dtheta) R^.
#pragma once

#include <Eigen/Core>

#include "estimator/measurements.h"
#include "estimator/relative_pose.h"

namespace covey {

using Matrix76d = Eigen::Matrix<double, 7, 6>;

// A keyframe as its drone's odometry has it, and the way over which the drone measured depths.
struct ObservedKeyframe {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();  // in the own world
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  // scale_gradient; zero where depths do not matter.
  Eigen::RowVector3d scale = Eigen::RowVector3d::Zero();
  double unshared = 0;  // variance, of how depths are wrong otherwise than the way
};

// Of a relative pose and the ratio of depths: what is left over, how it changes with the errors of
// both keyframes and of those since which depths were measured, and the covariance of its noise.
struct DriftObservation {
  Vector7d r = Vector7d::Zero();
  Matrix76d H_own = Matrix76d::Zero(), H_own_before = Matrix76d::Zero();
  Matrix76d H_other = Matrix76d::Zero(), H_other_before = Matrix76d::Zero();
  Matrix7d noise = Matrix7d::Identity();
};

// Without a ratio its row says nothing.
[[nodiscard]] DriftObservation observe_drift(const ObservedKeyframe& own,
                                             const ObservedKeyframe& other,
                                             const RelativePose& measurement,
                                             const DepthRatio* ratio);

// Of the relative pose, turned by R, and the ratio; without a ratio its row stands for itself.
[[nodiscard]] Matrix7d noise_of(const RelativePose& measurement, const DepthRatio* ratio,
                                const Eigen::Matrix3d& R);

}  // namespace covey
