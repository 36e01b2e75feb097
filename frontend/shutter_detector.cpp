// SPDX-License-Identifier: Apache-2.0
#include "frontend/shutter_detector.h"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <utility>

namespace covey {
namespace {

constexpr int kStep = 8;  // px

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
double noise_of(std::vector<std::uint16_t> steps) {
  constexpr double kPerMedian = 1.048;  // 1 / (0.6745 sqrt(2))
  if (steps.empty()) return 0;
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return kPerMedian * *middle;
}

}  // namespace

template <typename Pixel>
ShutterDetector::Samples ShutterDetector::sampled(const cv::Mat& image) {
  const std::size_t most = image.total() / kStep / kStep + 1;
  Samples samples;
  samples.greys.reserve(most);
  samples.steps.reserve(most);
  std::size_t i = 0;
  for (int y = kStep / 2; y < image.rows; y += kStep) {
    const Pixel* row = image.ptr<Pixel>(y);
    for (int x = kStep / 2; x + 1 < image.cols; x += kStep, ++i) {
      if (i == last_.size()) {
        last_.push_back(0);
        lit_.push_back(false);
      }
      const std::uint16_t before = std::exchange(last_[i], row[x]);
      const bool first = !lit_[i];
      lit_[i] = lit_[i] || row[x] > 0;
      if (!lit_[i] || (!mask_.empty() && mask_.at<std::uint8_t>(y, x) == 0)) continue;
      samples.greys.push_back(row[x]);
      samples.steps.push_back(static_cast<std::uint16_t>(std::abs(row[x + 1] - row[x])));
      samples.same += !first && row[x] == before ? 1 : 0;
    }
  }
  return samples;
}

ImageContent ShutterDetector::look(TimeNs stamp_ns, const cv::Mat& image) {
  Samples samples =
      image.depth() == CV_16U ? sampled<std::uint16_t>(image) : sampled<std::uint8_t>(image);
  const auto count = static_cast<double>(samples.greys.size());
  const bool repeated = static_cast<double>(samples.same) >= config_.repeated_share * count;
  const double noise = noise_of(std::move(samples.steps));
  const double limit = std::max(config_.uniform_range, config_.uniform_noises * noise);
  if (spread(std::move(samples.greys)) <= limit) return ImageContent::kUniform;
  if (!repeated) {
    scene_ns_ = stamp_ns;
    return ImageContent::kScene;
  }
  return seconds_between(scene_ns_, stamp_ns) < config_.frozen_s ? ImageContent::kRepeated
                                                                 : ImageContent::kFrozen;
}

}  // namespace covey
