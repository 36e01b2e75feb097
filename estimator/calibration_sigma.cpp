// SPDX-License-Identifier: Apache-2.0
#include "estimator/calibration_sigma.h"

namespace covey {

CalibrationSigma calibration_sigma_at_start(const EstimatorConfig& config) {
  CalibrationSigma sigma;
  if (config.calibrate_extrinsics) {
    sigma.p_imu_cam.setConstant(config.extrinsics_sigma_m);
    sigma.theta_imu_cam.setConstant(config.extrinsics_sigma_rad);
  }
  if (config.calibrate_time_offset) sigma.time_offset_s = config.time_offset_sigma_s;
  if (config.calibrate_intrinsics) {
    sigma.intrinsics.head<2>().setConstant(config.focal_length_sigma);
    sigma.intrinsics.segment<2>(2).setConstant(config.principal_point_sigma);
    sigma.intrinsics.tail<2>().setConstant(config.distortion_sigma);
  }
  return sigma;
}

}  // namespace covey
