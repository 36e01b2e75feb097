// SPDX-License-Identifier: Apache-2.0
//
// An IMU state carried over one increment, and what becomes of its error [dp dv dtheta dbg dba].
#pragma once

#include <Eigen/Core>
#include <vector>

#include "estimator/state.h"

namespace covey {

using Matrix15d = Eigen::Matrix<double, State::kImuSize, State::kImuSize>;

[[nodiscard]] ImuState carried_over(const ImuState& start, const ImuIncrement& increment,
                                    TimeNs end_ns, const Eigen::Vector3d& gravity_world);

// d(error at the end)/d(error at the start), first estimates at both ends, so that chained
// transitions keep the unobservable directions (Li and Mourikis, IJRR 2013, eq. 44).
[[nodiscard]] Matrix15d transition(const ImuIncrement& increment, const ImuState& first,
                                   const ImuState& end, const Eigen::Vector3d& gravity_world);

// d(error at the end)/d(ds): by how much velocity changes within dt, `dv`, and the camera swings
// about the IMU, `swing`, the IMU says in metres.
[[nodiscard]] Eigen::Matrix<double, State::kImuSize, 1> transition_by_scale(
    const Eigen::Vector3d& dv, double dt, const Eigen::Vector3d& swing);

// Covariance that the increment adds; `R`: imu to world at the start.
[[nodiscard]] Matrix15d process_noise(const ImuIncrement& increment, const Eigen::Matrix3d& R,
                                      const ImuNoise& noise);

// After an interval of which only the IMU tells.
[[nodiscard]] CoreState dead_reckoned(const CoreState& start, const ImuInterval& interval,
                                      const EstimatorConfig& config);

}  // namespace covey
