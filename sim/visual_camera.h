// SPDX-License-Identifier: Apache-2.0
//
// A grey visual sensor: lens falloff, automatic exposure that adapts slowly, shot and read noise,
// quantisation. Turns the renderer's radiance into 8-bit images.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "frontend/camera.h"
#include "sim/noise_table.h"

namespace covey {

struct VisualSensor {
  double exposure_s = 0.006;  // s, shutter time; the image stamp is its middle
  double target_level = 110;  // grey levels, the mean the automatic exposure works towards
  double adaptation_s = 0.6;  // s, time constant of the automatic exposure
  double vignetting = 0.35;   // loss of light in the corners, fraction
  double read_noise = 1.2;    // grey levels, standard deviation in the dark
  double shot_noise = 0.11;   // grey levels for a square root of a grey level
};

class VisualCamera {
 public:
  VisualCamera(const CameraIntrinsics& camera, const VisualSensor& sensor, std::uint64_t seed);

  // CV_32FC1 radiance (already blurred by motion) to CV_8UC1; `since_last_s` since the image
  // before.
  [[nodiscard]] cv::Mat expose(const cv::Mat& radiance, double since_last_s);

  // Grey levels for a unit of radiance, as of the last image.
  [[nodiscard]] double gain() const { return gain_; }

 private:
  void adapt(const cv::Mat& radiance, double since_last_s);

  VisualSensor sensor_;
  NoiseTable noise_;
  cv::Mat falloff_;  // CV_32FC1, 1 in the middle
  double gain_ = 0;  // 0 until the first image
};

}  // namespace covey
