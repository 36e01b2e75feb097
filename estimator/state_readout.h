// SPDX-License-Identifier: Apache-2.0
//
// What the filter tells of its state, in metres and in the world.
#pragma once

#include "estimator/calibration_sigma.h"
#include "estimator/estimator.h"
#include "estimator/state.h"

namespace covey {

// Its status is the filter's health, which a state does not know: kUninitialized.
[[nodiscard]] Odometry odometry_of(const CoreState& core);

// At the newest clone, which there must be.
[[nodiscard]] CameraEstimate camera_of(const State& state);

[[nodiscard]] CalibrationSigma calibration_sigma_of(const State& state);

}  // namespace covey
