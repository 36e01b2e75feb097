// SPDX-License-Identifier: Apache-2.0
//
// EuRoC sensor.yaml files, with or without their "%YAML:1.0" line: camera and IMU calibration.
#pragma once

#include <filesystem>

#include "estimator/config.h"
#include "frontend/camera.h"

namespace covey {

struct CameraCalibration {
  CameraIntrinsics intrinsics;
  CameraExtrinsics extrinsics;  // the body is the IMU
  bool thermal = false;         // its comment says so
};

// Both throw std::runtime_error naming file, key and line.
[[nodiscard]] CameraCalibration read_camera_file(const std::filesystem::path& yaml);
[[nodiscard]] ImuNoise read_imu_file(const std::filesystem::path& yaml);

}  // namespace covey
