// SPDX-License-Identifier: Apache-2.0
#include "frontend/image_pyramid.h"

#include <opencv2/imgproc.hpp>

namespace covey {

ImagePyramid build_pyramid(const cv::Mat& pixels, int levels) {
  ImagePyramid pyramid;
  pyramid.levels.resize(static_cast<std::size_t>(levels));
  pixels.copyTo(pyramid.levels[0]);
  for (std::size_t l = 1; l < pyramid.levels.size(); ++l) {
    cv::pyrDown(pyramid.levels[l - 1], pyramid.levels[l]);
  }
  return pyramid;
}

}  // namespace covey
