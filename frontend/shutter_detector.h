// SPDX-License-Identifier: Apache-2.0
//
// Images in which a thermal camera does not see: while it looks at its shutter for a flat-field
// correction it repeats its last image, or shows the shutter itself, which is uniform. A driver may
// repeat an image as well, and a slow camera's output may give each of them twice or three times:
// that goes by sooner.
#pragma once

#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

struct ShutterConfig {
  double repeated_share = 0.98;  // of pixels that are what they were, in a repeated image
  double frozen_s = 0.15;        // s since another image, from which on the camera does not see
  // A uniform image's grey levels lie so close together, between the 1st and the 99th percentile:
  double uniform_noises = 6;  // of noise's standard deviations, which alone spreads 4.7,
  double uniform_range = 2;   // or this many levels, whatever the noise
};

enum class ImageContent {
  kScene,
  kRepeated,  // the one before once more, which says nothing
  kFrozen,    // and that for so long that the camera looks at its shutter
  kUniform
};

// Then the sensor may have become another one.
[[nodiscard]] inline bool is_blind(ImageContent content) {
  return content == ImageContent::kFrozen || content == ImageContent::kUniform;
}

class ShutterDetector {
 public:
  // `mask`: as the tracker's; what it leaves out counts as little as what has been black in every
  // image: a surround is not the scene, and there whether the shutter is closed or not.
  explicit ShutterDetector(const ShutterConfig& config, const cv::Mat& mask = cv::Mat())
      : config_(config), mask_(mask) {}

  // CV_8UC1 or CV_16UC1, in time order.
  [[nodiscard]] ImageContent look(TimeNs stamp_ns, const cv::Mat& image);

 private:
  struct Samples {
    std::vector<std::uint16_t> greys;
    std::vector<std::uint16_t> steps;  // to the pixels beside them
    std::size_t same = 0;              // as in the last image
  };
  ShutterConfig config_;
  template <typename Pixel>
  [[nodiscard]] Samples sampled(const cv::Mat& image);

  cv::Mat mask_;
  TimeNs scene_ns_ = 0;  // stamp of the last image that showed a scene
  // Of every eighth pixel of every eighth row: its grey level, and whether it has ever had one.
  std::vector<std::uint16_t> last_;
  std::vector<bool> lit_;
};

}  // namespace covey
