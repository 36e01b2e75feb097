// SPDX-License-Identifier: Apache-2.0
//
// The sensor's own pattern as a ruler for automatic gain. Each pixel and each column reads a little
// too much or too little, in temperature, and always the same until the camera looks at its
// shutter. Automatic gain stretches that pattern together with the scene, so how strongly it stands
// in an image tells the image's gain: without a track, whatever field lies over it, and with no
// error that adds up. The pattern is what neighbours along a row differ by in every image, while
// the scene moves past.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

namespace covey {

struct PatternGainConfig {
  double travel_px = 6;  // that the scene moves between two looks, px
  int memory = 50;       // looks that count, of each half
  int fewest_looks = 4;  // of both halves together, before it is known
  double edge = 6;       // times the mean step: a larger one is the scene's, not the pattern's
  double trusted_sigma = 0.1;  // of the logarithm of a gain; what is less certain is not told
  int contradictions = 15;  // images in a row in which tracks deny it: the pattern is another one
};

// Of the map from an image's grey levels to calibrated ones.
struct MeasuredGain {
  double log_gain = 0, sigma = 0;
};

class PatternGain {
 public:
  explicit PatternGain(const PatternGainConfig& config) : config_(config) {}

  // Images are CV_8UC1 or CV_16UC1, all of one size; pixels that are black or have `white` say
  // nothing.
  // Forgets: the pattern is another one, and gains are told against that of `first`.
  void restart(const cv::Mat& first, int white, double gain);
  // The scene has moved by `travel_px` since the last look. `gain`: of the image, as far as known.
  void look(const cv::Mat& image, int white, double gain);
  // Nothing as long as too little of a pattern is known, or seen.
  [[nodiscard]] std::optional<MeasuredGain> measure(const cv::Mat& image, int white) const;

 private:
  void learn_waiting();
  void tell_pattern();
  [[nodiscard]] std::optional<MeasuredGain> against_pattern(const cv::Mat& image, int white) const;

  struct Look {
    cv::Mat image;
    int white = 0;
    double gain = 1;
  };
  PatternGainConfig config_;
  Look first_;    // against which gains are told
  Look waiting_;  // the last one: images after it still show its scene
  int looks_ = 0;
  // Of every other row, means of every other look each, CV_32FC1: noise and scene of one are not in
  // the other, and what both agree on is the pattern.
  std::array<cv::Mat, 2> halves_;
  cv::Mat pattern_;                   // CV_16SC1, mean of both halves
  std::vector<double> power_;         // mean of their product, times pattern_'s scale; each block
  std::optional<MeasuredGain> unit_;  // of the first image, against the pattern
};

}  // namespace covey
