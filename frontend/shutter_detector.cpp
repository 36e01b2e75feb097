// SPDX-License-Identifier: Apache-2.0
#include "frontend/shutter_detector.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <utility>

namespace covey {
namespace {

constexpr int kStep = 8;  // px

template <typename Pixel>
std::vector<std::uint16_t> thinned(const cv::Mat& image) {
  std::vector<std::uint16_t> sample;
  sample.reserve((static_cast<std::size_t>(image.rows) / kStep + 1) *
                 (static_cast<std::size_t>(image.cols) / kStep + 1));
  for (int y = kStep / 2; y < image.rows; y += kStep) {
    const Pixel* row = image.ptr<Pixel>(y);
    for (int x = kStep / 2; x < image.cols; x += kStep) sample.push_back(row[x]);
  }
  return sample;
}

// Between the 1st and the 99th percentile.
double spread(std::vector<std::uint16_t> sample) {
  if (sample.empty()) return 0;
  const auto ignored = static_cast<std::ptrdiff_t>(sample.size() / 100);
  const auto low = sample.begin() + ignored, high = sample.end() - 1 - ignored;
  std::nth_element(sample.begin(), low, sample.end());
  const int darkest = *low;
  std::nth_element(sample.begin(), high, sample.end());
  return *high - darkest;
}

// Standard deviation, grey levels: by how much a pixel differs from the one beside it, where there
// is no edge.
template <typename Pixel>
double noise_of(const cv::Mat& image) {
  constexpr double kPerMedian = 1.048;  // 1 / (0.6745 sqrt(2))
  std::vector<std::uint16_t> steps;
  steps.reserve(image.total() / kStep / kStep + 1);
  for (int y = kStep / 2; y < image.rows; y += kStep) {
    const Pixel* row = image.ptr<Pixel>(y);
    for (int x = kStep / 2; x + 1 < image.cols; x += kStep) {
      steps.push_back(static_cast<std::uint16_t>(std::abs(row[x + 1] - row[x])));
    }
  }
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return kPerMedian * *middle;
}

}  // namespace

ImageContent ShutterDetector::look(TimeNs stamp_ns, const cv::Mat& image) {
  const bool wide = image.depth() == CV_16U;
  std::vector<std::uint16_t> sample =
      wide ? thinned<std::uint16_t>(image) : thinned<std::uint8_t>(image);
  std::size_t same = 0;
  if (sample.size() == last_.size()) {
    for (std::size_t i = 0; i < sample.size(); ++i) same += sample[i] == last_[i] ? 1 : 0;
  }
  const bool repeated =
      !last_.empty() &&
      static_cast<double>(same) >= config_.repeated_share * static_cast<double>(sample.size());
  last_ = std::move(sample);
  const double noise = wide ? noise_of<std::uint16_t>(image) : noise_of<std::uint8_t>(image);
  const double limit = std::max(config_.uniform_range, config_.uniform_noises * noise);
  if (spread(last_) <= limit) return ImageContent::kUniform;
  if (!repeated) {
    scene_ns_ = stamp_ns;
    return ImageContent::kScene;
  }
  return seconds_between(scene_ns_, stamp_ns) < config_.frozen_s ? ImageContent::kRepeated
                                                                 : ImageContent::kFrozen;
}

}  // namespace covey
