// SPDX-License-Identifier: Apache-2.0
//
// An uncooled sensor is read out by columns and rows, and each of them always reads a little too
// much or too little. Such stripes lie within a patch from top to bottom, so they pull at an
// alignment more than much larger noise of single pixels. They are found where the scene moves past
// them: what neighbouring pixels differ by is the scene's in every image anew, and the stripes' in
// all of them. Differences that are too large to be stripes are edges, and not counted.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

namespace covey {

struct StripeConfig {
  double travel_px = 10;  // that the scene moves between two looks, px
  int window_px = 15;     // columns or rows whose mean is the scene's: stripes are narrower
  double edge = 2;        // times what neighbours typically differ by: more is the scene's
  int memory = 100;       // looks that count
  int trial = 3;          // looks after which stripes are half believed
  int kept = 10;          // looks that count after the camera looked at its shutter, at most
};

class StripePattern {
 public:
  StripePattern(const StripeConfig& config, cv::Size image_size);

  // `levels`: CV_16SC1, as the sensor has them; kNoLevel where it has none.
  static constexpr std::int16_t kNoLevel = INT16_MIN;
  void look(const cv::Mat& levels);
  // The sensor has corrected itself: what was seen counts less.
  void doubt();
  // Levels have become `factor` times what they were, and the stripes with them.
  void scale(float factor);

  // Adds the stripes, levels, to an image of CV_16SC1.
  void add_to(cv::Mat& image) const;

 private:
  StripeConfig config_;
  int looks_ = 0;
  std::vector<float> column_steps_, row_steps_;  // from each to the next, levels
};

}  // namespace covey
