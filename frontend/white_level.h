// SPDX-License-Identifier: Apache-2.0
//
// The grey level at which a sensor saturates. An image of 16 bits may come from a sensor of 12 or
// 14: its brightest pixels then tell, which all have the largest value of so many bits.
#pragma once

#include <opencv2/core.hpp>

namespace covey {

// `image`: CV_8UC1 or CV_16UC1.
[[nodiscard]] inline int white_level(const cv::Mat& image) {
  constexpr int kWhite8 = 255, kWhite16 = 65535, kWhite10 = 1023;
  if (image.depth() == CV_8U) return kWhite8;
  double most = 0;
  cv::minMaxIdx(image, nullptr, &most);
  const int brightest = static_cast<int>(most);
  const bool all_bits = (brightest & (brightest + 1)) == 0;
  return all_bits && brightest >= kWhite10 ? brightest : kWhite16;
}

}  // namespace covey
