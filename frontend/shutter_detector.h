// SPDX-License-Identifier: Apache-2.0
//
// Images in which a thermal camera does not see: while it looks at its shutter for a flat-field
// correction it repeats its last image, or shows the shutter itself, which is uniform.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace covey {

struct ShutterConfig {
  double repeated_share = 0.98;  // of pixels that are what they were, in a repeated image
  // A uniform image's grey levels lie so close together, between the 1st and the 99th percentile:
  double uniform_noises = 6;  // of noise's standard deviations, which alone spreads 4.7,
  double uniform_range = 2;   // or this many levels, whatever the noise
};

enum class ImageContent { kScene, kRepeated, kUniform };

class ShutterDetector {
 public:
  explicit ShutterDetector(const ShutterConfig& config) : config_(config) {}

  // CV_8UC1 or CV_16UC1, in time order.
  [[nodiscard]] ImageContent look(const cv::Mat& image);

 private:
  ShutterConfig config_;
  std::vector<std::uint16_t> last_;  // every eighth pixel of every eighth row
};

}  // namespace covey
