// SPDX-License-Identifier: Apache-2.0
//
// How well the camera's calibration is known.
#pragma once

#include <Eigen/Core>

#include "estimator/config.h"
#include "estimator/measurements.h"

namespace covey {

// Standard deviations of what is calibrated in flight; zero where it is not.
struct CalibrationSigma {
  Eigen::Vector3d p_imu_cam = Eigen::Vector3d::Zero();      // m
  Eigen::Vector3d theta_imu_cam = Eigen::Vector3d::Zero();  // rad
  double time_offset_s = 0;
  IntrinsicsError intrinsics = IntrinsicsError::Zero();
};

// Before the flight: as far as the configuration believes what it says.
[[nodiscard]] CalibrationSigma calibration_sigma_at_start(const EstimatorConfig& config);

}  // namespace covey
