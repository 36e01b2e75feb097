// SPDX-License-Identifier: Apache-2.0
#include "frontend/white_level.h"

namespace covey {
namespace {

constexpr int kWhite8 = 255, kWhite16 = 65535, kWhite10 = 1023;

bool is_largest_of_its_bits(int grey) { return (grey & (grey + 1)) == 0 && grey >= kWhite10; }

// In a scene the brightest values are the rarest. Of a uniform image nobody knows.
bool is_cut_off_at(const cv::Mat& image, int brightest, double share) {
  constexpr int kOutnumbered = 4;  // times the pixels of the next value below
  const double least = share * static_cast<double>(image.total());
  const int cut_off = cv::countNonZero(image == brightest);
  if (cut_off < least || static_cast<double>(image.total()) - cut_off < least) return false;
  double next = 0;
  cv::minMaxIdx(image, nullptr, &next, nullptr, nullptr, image < brightest);
  return cut_off > kOutnumbered * cv::countNonZero(image == next);
}

}  // namespace

int white_level(const cv::Mat& image, double cut_off_share) {
  if (image.depth() == CV_8U) return kWhite8;
  double most = 0;
  cv::minMaxIdx(image, nullptr, &most);
  const int brightest = static_cast<int>(most);
  const bool saturated =
      is_largest_of_its_bits(brightest) || is_cut_off_at(image, brightest, cut_off_share);
  return saturated ? brightest : kWhite16;
}

}  // namespace covey
