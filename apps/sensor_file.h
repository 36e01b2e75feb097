// SPDX-License-Identifier: Apache-2.0
//
// EuRoC sensor.yaml files, with or without their "%YAML:1.0" line: camera and IMU calibration.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "estimator/config.h"
#include "frontend/camera.h"

namespace covey {

struct CameraCalibration {
  CameraIntrinsics intrinsics;
  CameraExtrinsics extrinsics;  // the body is the IMU
  bool thermal = false;         // its comment says so
  // s, by which each row of pixels looks later than the one above it (rolling shutter); stamps are
  // of the middle row.
  double line_delay_s = 0;
};

// What can hardly be meant, one line each: units or fields that were mixed up, most often. `file`:
// named in it.
[[nodiscard]] std::vector<std::string> doubts_about(const CameraCalibration& camera,
                                                    const std::filesystem::path& file);
[[nodiscard]] std::vector<std::string> doubts_about(const ImuNoise& noise,
                                                    const std::filesystem::path& file);

// Both throw std::runtime_error naming file, key and line.
[[nodiscard]] CameraCalibration read_camera_file(const std::filesystem::path& yaml);
[[nodiscard]] ImuNoise read_imu_file(const std::filesystem::path& yaml);

}  // namespace covey
