// SPDX-License-Identifier: Apache-2.0
//
// A recording's images as a camera in the air would give them: those of damaged files are left out
// and counted, and the first of them is told.
#pragma once

#include <atomic>
#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <optional>

#include "apps/dataset.h"

namespace covey {

class ImageReader {
 public:
  explicit ImageReader(const CameraIntrinsics& camera)
      : width_(camera.width), height_(camera.height) {}

  // Nothing if the file cannot be read.
  [[nodiscard]] std::optional<cv::Mat> read(const ImageEntry& image);
  [[nodiscard]] std::uint64_t left_out() const { return left_out_; }

 private:
  int width_, height_;
  std::atomic<std::uint64_t> left_out_ = 0;  // told while another thread reads
};

}  // namespace covey
