// SPDX-License-Identifier: Apache-2.0
#include "sim/visual_camera.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>

namespace covey {

VisualCamera::VisualCamera(const CameraIntrinsics& camera, const VisualSensor& sensor,
                           std::uint64_t seed)
    : sensor_(sensor), noise_(seed), falloff_(camera.height, camera.width, CV_32FC1) {
  const double corner2 = std::pow(std::max(camera.cx, camera.width - camera.cx), 2) +
                         std::pow(std::max(camera.cy, camera.height - camera.cy), 2);
  for (int y = 0; y < camera.height; ++y)
    for (int x = 0; x < camera.width; ++x) {
      const double r2 = std::pow(x - camera.cx, 2) + std::pow(y - camera.cy, 2);
      falloff_.at<float>(y, x) = static_cast<float>(1 - sensor.vignetting * r2 / corner2);
    }
}

void VisualCamera::adapt(const cv::Mat& radiance, double since_last_s) {
  const double wanted = sensor_.target_level / std::max(1e-3, cv::mean(radiance)[0]);
  if (gain_ == 0) {
    gain_ = wanted;
    return;
  }
  const double step = 1 - std::exp(-since_last_s / sensor_.adaptation_s);
  gain_ *= std::pow(wanted / gain_, step);
}

cv::Mat VisualCamera::expose(const cv::Mat& radiance, double since_last_s) {
  adapt(radiance, since_last_s);
  cv::Mat image(radiance.size(), CV_8UC1);
  const float gain = static_cast<float>(gain_);
  const float read2 = static_cast<float>(sensor_.read_noise * sensor_.read_noise);
  const float shot2 = static_cast<float>(sensor_.shot_noise * sensor_.shot_noise);
  for (int y = 0; y < radiance.rows; ++y) {
    const float* light = radiance.ptr<float>(y);
    const float* falloff = falloff_.ptr<float>(y);
    const float* noise = noise_.next_row();
    std::uint8_t* out = image.ptr<std::uint8_t>(y);
    for (int x = 0; x < radiance.cols; ++x) {
      const float level = gain * light[x] * falloff[x];
      const float sigma = std::sqrt(read2 + shot2 * level);
      out[x] = static_cast<std::uint8_t>(std::clamp(level + sigma * noise[x] + 0.5f, 0.0f, 255.0f));
    }
  }
  return image;
}

}  // namespace covey
