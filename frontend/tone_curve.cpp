// SPDX-License-Identifier: Apache-2.0
#include "frontend/tone_curve.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace covey {
void ToneCurve::reset() {
  empty_ = true;
  share_.fill(1.0 / kBins);
  rebuild();
}

void ToneCurve::adapt(const std::vector<int>& sample, double elapsed_s) {
  if (sample.empty()) return;
  std::array<double, kBins> seen{};
  const double one = 1 / static_cast<double>(sample.size());
  for (const int level : sample) seen[static_cast<std::size_t>(level * kBins / kLevels)] += one;
  const double keep = empty_ ? 0 : std::exp(-elapsed_s / config_.adapt_s);
  empty_ = false;
  for (std::size_t i = 0; i < kBins; ++i) share_[i] = keep * share_[i] + (1 - keep) * seen[i];
  rebuild();
}

void ToneCurve::rebuild() {
  // The bins that hold all but the ignored pixels.
  std::size_t low = 0, high = kBins - 1;
  for (double sum = share_[low]; low < high && sum <= config_.ignored_share;) sum += share_[++low];
  for (double sum = share_[high]; high > low && sum <= config_.ignored_share;)
    sum += share_[--high];
  const double bins = static_cast<double>(high - low + 1);

  // Slope of each bin: uniform, or as often as it occurs but within limits (Pizer et al. 1987).
  std::array<double, kBins> slope{};
  double total = 0;
  for (std::size_t i = low; i <= high; ++i) {
    const double wanted = share_[i] * bins;
    slope[i] = config_.contrast == Contrast::kLinear
                   ? 1.0
                   : std::clamp(wanted, config_.min_slope, config_.max_slope);
    total += slope[i];
  }
  constexpr int kWide = kLevels / kBins;
  const double darkest = config_.margin, brightest = 255 - darkest;
  double grey = darkest;
  const double scale = (brightest - darkest) / (total * kWide);
  const double tail = (brightest - darkest) / (bins * kWide) / 4;  // gently, until black or white
  for (int level = 0; level < kLevels; ++level) {
    const auto bin = static_cast<std::size_t>(level / kWide);
    if (bin < low) {
      const double below = static_cast<double>(low) * kWide - level;
      table_[static_cast<std::size_t>(level)] =
          static_cast<std::uint8_t>(std::max(0.0, darkest - below * tail));
      continue;
    }
    grey += bin <= high ? slope[bin] * scale : tail;
    table_[static_cast<std::size_t>(level)] = static_cast<std::uint8_t>(std::min(255.0, grey));
  }
}

}  // namespace covey
