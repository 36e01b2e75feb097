// SPDX-License-Identifier: Apache-2.0
//
// Dead and hot pixels: those that always stand out against their neighbours while the scene moves
// past them. Not thread-safe; same input, same output.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace covey {

struct BadPixelConfig {
  double interval_s = 1;      // s between two checks
  double deviations = 8;      // from the median of its neighbours, robust deviations of all pixels
  double travel_px = 4;       // of the scene between two checks
  int checks = 3;             // one after the other, before a pixel is replaced
  double most_share = 0.002;  // of the pixels may be bad; more is something else
};

class BadPixels {
 public:
  explicit BadPixels(const BadPixelConfig& config) : config_(config) {}

  // CV_8UC1 or CV_16UC1, as the sensor gave it. When to look, and that the scene has moved since
  // the last look, is the caller's to know.
  void look(const cv::Mat& image);

  // By rows.
  [[nodiscard]] const std::vector<cv::Point>& found() const { return found_; }

  // `image`: CV_8UC1. Each gets the mean of the pixels beside it that are not bad themselves.
  void replace(cv::Mat& image) const;

 private:
  BadPixelConfig config_;
  std::vector<cv::Point> suspects_, found_;  // by rows
  std::vector<int> suspicion_;               // looks in a row in which suspects_[i] stood out
};

}  // namespace covey
