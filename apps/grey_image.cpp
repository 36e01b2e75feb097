// SPDX-License-Identifier: Apache-2.0
#include "apps/grey_image.h"

#include <algorithm>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace covey {
namespace {

constexpr double kIgnoredShare = 0.005;  // at either end
constexpr int kSampleStep = 4;           // px; every 16th pixel tells enough

struct GreyRange {
  double darkest = 0, brightest = 1;
};

GreyRange range_of(const cv::Mat& image) {
  std::vector<std::uint16_t> sample;
  for (int y = 0; y < image.rows; y += kSampleStep) {
    for (int x = 0; x < image.cols; x += kSampleStep)
      sample.push_back(image.at<std::uint16_t>(y, x));
  }
  if (sample.empty()) return {};
  const auto ignored =
      static_cast<std::ptrdiff_t>(kIgnoredShare * static_cast<double>(sample.size()));
  const auto low = sample.begin() + ignored;
  const auto high = sample.end() - 1 - ignored;
  std::nth_element(sample.begin(), low, sample.end());
  const double darkest = *low;
  std::nth_element(sample.begin(), high, sample.end());
  return {darkest, std::max<double>(*high, darkest + 1)};
}

}  // namespace

cv::Mat to_grey8(const cv::Mat& image) {
  if (image.depth() == CV_8U) return image;
  const GreyRange range = range_of(image);
  const double scale = 255 / (range.brightest - range.darkest);
  cv::Mat grey;
  image.convertTo(grey, CV_8U, scale, -scale * range.darkest);
  return grey;
}

}  // namespace covey
