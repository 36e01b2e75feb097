// SPDX-License-Identifier: Apache-2.0
#include "frontend/stripe_pattern.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>

namespace covey {
namespace {

// Of the differences between neighbours that are small enough to be stripes and noise.
struct Steps {
  explicit Steps(std::size_t count) : sum(count, 0), seen(count, 0) {}
  std::vector<float> sum;
  std::vector<int> seen;
};

// How much neighbours along a row differ, mean of absolute values, from every eighth row.
float typical_step(const cv::Mat& levels) {
  constexpr int kEvery = 8;
  double sum = 0;
  int count = 0;
  for (int y = 0; y < levels.rows; y += kEvery) {
    const auto* row = levels.ptr<std::int16_t>(y);
    for (int x = 0; x + 1 < levels.cols; ++x) {
      if (row[x] == StripePattern::kNoLevel || row[x + 1] == StripePattern::kNoLevel) continue;
      sum += std::abs(row[x + 1] - row[x]);
      ++count;
    }
  }
  return count > 0 ? static_cast<float>(sum / count) : 0;
}

void learn(std::vector<float>& steps, const Steps& seen, float share) {
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (seen.seen[i] > 0) steps[i] += share * seen.sum[i] / static_cast<float>(seen.seen[i]);
  }
}

// The stripes, out of the steps between them: summed up, without what a window's mean has.
std::vector<float> stripes_of(const std::vector<float>& steps, int window) {
  std::vector<float> level(steps.size() + 1, 0), before(steps.size() + 2, 0);
  for (std::size_t i = 0; i < steps.size(); ++i) level[i + 1] = level[i] + steps[i];
  for (std::size_t i = 0; i < level.size(); ++i) before[i + 1] = before[i] + level[i];
  std::vector<float> stripes(level.size());
  for (std::size_t i = 0; i < level.size(); ++i) {
    const std::size_t reach =
        std::min({static_cast<std::size_t>(window) / 2, i, level.size() - 1 - i});
    const float sum = before[i + reach + 1] - before[i - reach];
    stripes[i] = level[i] - sum / static_cast<float>(2 * reach + 1);
  }
  return stripes;
}

}  // namespace

StripePattern::StripePattern(const StripeConfig& config, cv::Size image_size)
    : config_(config),
      column_steps_(static_cast<std::size_t>(image_size.width - 1), 0),
      row_steps_(static_cast<std::size_t>(image_size.height - 1), 0) {}

void StripePattern::look(const cv::Mat& levels) {
  constexpr float kEdge = 2;  // times what neighbours typically differ by
  const float most = kEdge * typical_step(levels);
  Steps columns(column_steps_.size()), rows(row_steps_.size());
  for (int y = 0; y < levels.rows; ++y) {
    const auto* row = levels.ptr<std::int16_t>(y);
    const bool last = y + 1 == levels.rows;
    const auto* below = last ? row : levels.ptr<std::int16_t>(y + 1);
    const float row_step = last ? 0 : row_steps_[static_cast<std::size_t>(y)];
    float down = 0;
    int counted = 0;
    for (int x = 0; x < levels.cols; ++x) {
      if (row[x] == kNoLevel) continue;
      const auto i = static_cast<std::size_t>(x);
      if (x + 1 < levels.cols && row[x + 1] != kNoLevel) {
        const float rest = static_cast<float>(row[x + 1] - row[x]) - column_steps_[i];
        const bool small = std::abs(rest) <= most;
        columns.sum[i] += small ? rest : 0;
        columns.seen[i] += small ? 1 : 0;
      }
      if (below[x] == kNoLevel) continue;
      const float rest = static_cast<float>(below[x] - row[x]) - row_step;
      const bool small = std::abs(rest) <= most;
      down += small ? rest : 0;
      counted += small ? 1 : 0;
    }
    if (last) continue;
    rows.sum[static_cast<std::size_t>(y)] = down;
    rows.seen[static_cast<std::size_t>(y)] = counted;
  }
  looks_ = std::min(looks_ + 1, config_.memory);
  learn(column_steps_, columns, 1 / static_cast<float>(looks_));
  learn(row_steps_, rows, 1 / static_cast<float>(looks_));
}

void StripePattern::doubt() { looks_ = std::min(looks_, config_.kept); }

void StripePattern::add_to(cv::Mat& image) const {
  if (looks_ == 0) return;
  const float trust = static_cast<float>(looks_) / static_cast<float>(looks_ + config_.trial);
  const std::vector<float> columns = stripes_of(column_steps_, config_.window_px);
  const std::vector<float> rows = stripes_of(row_steps_, config_.window_px);
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<std::int16_t>(y);
    const float of_row = rows[static_cast<std::size_t>(y)];
    for (int x = 0; x < image.cols; ++x) {
      const float stripe = trust * (of_row + columns[static_cast<std::size_t>(x)]);
      row[x] = static_cast<std::int16_t>(row[x] + std::lrint(stripe));
    }
  }
}

}  // namespace covey
