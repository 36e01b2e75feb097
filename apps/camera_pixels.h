// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include "comms/onboard_messages.h"

namespace covey {

// CV_8UC1 or CV_16UC1 of the same memory: as long as `image` lives.
[[nodiscard]] inline cv::Mat pixels_of(CameraImage& image) {
  const int type = image.bytes_per_pixel == 1 ? CV_8UC1 : CV_16UC1;
  return {image.height, image.width, type, image.pixels.data()};
}

// Of CV_8UC1 or CV_16UC1, a copy.
[[nodiscard]] inline CameraImage to_camera_image(TimeNs stamp_ns, const cv::Mat& pixels) {
  const cv::Mat rows = pixels.isContinuous() ? pixels : pixels.clone();
  CameraImage image{stamp_ns, pixels.cols, pixels.rows, static_cast<int>(pixels.elemSize()), {}};
  image.pixels.assign(rows.data, rows.data + rows.total() * rows.elemSize());
  return image;
}

}  // namespace covey
