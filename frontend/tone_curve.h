// SPDX-License-Identifier: Apache-2.0
//
// Calibrated grey levels to the 8 bits that the tracker looks at. The curve never falls, rises over
// the image's levels and a little beyond, and then is flat; and it changes slowly, so that a patch
// looks the same in the next image.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

namespace covey {

enum class Contrast { kLinear, kEqualised };

struct ToneConfig {
  Contrast contrast = Contrast::kEqualised;
  double ignored_share = 0.002;  // of the pixels, darkest and brightest, need not be told apart
  double max_slope = 3;          // of an equalised curve, times that of the linear one
  double min_slope = 0.2;        // of it, likewise
  int margin = 8;        // grey levels left free at either end: what is hotter still differs
  double adapt_s = 1.5;  // s, time constant with which the curve follows the images
};

class ToneCurve {
 public:
  static constexpr int kLevels = 4096;  // calibrated levels it distinguishes

  explicit ToneCurve(const ToneConfig& config) : config_(config) { reset(); }

  // `sample`: calibrated levels 0..kLevels-1 of pixels from all over the image.
  void adapt(const std::vector<int>& sample, double elapsed_s);
  void reset();

  [[nodiscard]] const std::array<std::uint8_t, kLevels>& table() const { return table_; }

 private:
  static constexpr int kBins = 512;
  void rebuild();

  ToneConfig config_;
  std::array<double, kBins> share_{};  // of the pixels in each bin, smoothed; sums to 1
  bool empty_ = true;
  std::array<std::uint8_t, kLevels> table_{};
};

}  // namespace covey
