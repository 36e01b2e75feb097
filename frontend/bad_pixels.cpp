// SPDX-License-Identifier: Apache-2.0
#include "frontend/bad_pixels.h"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace covey {
namespace {

bool by_rows(const cv::Point& a, const cv::Point& b) {
  return std::pair(a.y, a.x) < std::pair(b.y, b.x);
}

// Pixels that differ from their neighbours' median by so many of what is typical, by rows.
std::vector<cv::Point> standing_out(const cv::Mat& image, double deviations) {
  constexpr double kPerMeanAbsolute = 1.25;  // standard deviation
  cv::Mat smooth, difference, above;
  cv::medianBlur(image, smooth, 3);
  cv::absdiff(image, smooth, difference);
  double total = 0;
  int count = 0;
  constexpr int kEvery = 8;  // row
  for (int y = 0; y < image.rows; y += kEvery, ++count) {
    const cv::Mat row = difference.row(y);
    total += cv::mean(row)[0];
  }
  const double typical = std::max(0.5, total / std::max(1, count));
  cv::compare(difference, deviations * kPerMeanAbsolute * typical, above, cv::CMP_GT);
  std::vector<cv::Point> found;
  cv::findNonZero(above, found);
  return found;
}

}  // namespace

// Many stand out once in a busy scene, hardly any for long.
void BadPixels::look(const cv::Mat& image) {
  std::vector<cv::Point> standing = standing_out(image, config_.deviations);
  std::vector<int> suspicion(standing.size(), 1);
  for (std::size_t i = 0; i < standing.size(); ++i) {
    const auto before = std::lower_bound(suspects_.begin(), suspects_.end(), standing[i], by_rows);
    if (before == suspects_.end() || *before != standing[i]) continue;
    suspicion[i] += suspicion_[static_cast<std::size_t>(before - suspects_.begin())];
  }
  suspects_ = std::move(standing);
  suspicion_ = std::move(suspicion);
  found_.clear();
  for (std::size_t i = 0; i < suspects_.size(); ++i) {
    if (suspicion_[i] >= config_.checks) found_.push_back(suspects_[i]);
  }
  const double most = config_.most_share * static_cast<double>(image.total());
  if (static_cast<double>(found_.size()) >= most) found_.clear();
}

void BadPixels::replace(cv::Mat& image) const {
  const auto is_bad = [this](const cv::Point& p) {
    return std::binary_search(found_.begin(), found_.end(), p, by_rows);
  };
  const cv::Rect inside(0, 0, image.cols, image.rows);
  for (const cv::Point& p : found_) {
    int sum = 0, count = 0;
    for (const cv::Point& beside : {cv::Point(-1, 0), {1, 0}, {0, -1}, {0, 1}}) {
      if (!inside.contains(p + beside) || is_bad(p + beside)) continue;
      sum += image.at<std::uint8_t>(p + beside);
      ++count;
    }
    if (count > 0) image.at<std::uint8_t>(p) = static_cast<std::uint8_t>(sum / count);
  }
}

}  // namespace covey
