// SPDX-License-Identifier: Apache-2.0
//
// An image and its halves. A pixel (x, y) of level l lies at (x, y) * 2^l in the image itself.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace covey {

struct ImagePyramid {
  std::vector<cv::Mat> levels;  // CV_8UC1, [0] is the image itself
};

// Copies the image: the caller may reuse its buffer.
[[nodiscard]] ImagePyramid build_pyramid(const cv::Mat& pixels, int levels);

}  // namespace covey
