// SPDX-License-Identifier: Apache-2.0
#include "frontend/stripe_pattern.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>

namespace covey {
namespace {

// Differences between neighbours that are small enough to be stripes and noise: from the lesser to
// the greater limit. Whole numbers, so that compilers add up several at once.
struct Steps {
  explicit Steps(const std::vector<float>& known, float reach)
      : least(known.size()), most(known.size()), sum(known.size(), 0), seen(known.size(), 0) {
    for (std::size_t i = 0; i < known.size(); ++i) {
      least[i] = static_cast<int>(std::ceil(known[i] - reach));
      most[i] = static_cast<int>(std::floor(known[i] + reach));
    }
  }
  std::vector<int> least, most, sum, seen;
};

int is_small(int from, int to, int least, int most) {
  const int step = to - from;
  return static_cast<int>(from != StripePattern::kNoLevel) &
         static_cast<int>(to != StripePattern::kNoLevel) & static_cast<int>(step >= least) &
         static_cast<int>(step <= most);
}

// From each column to the next, along one row.
void add_across(const std::int16_t* row, Steps& steps) {
  for (std::size_t x = 0; x < steps.sum.size(); ++x) {
    const int small = is_small(row[x], row[x + 1], steps.least[x], steps.most[x]);
    steps.sum[x] += small * (row[x + 1] - row[x]);
    steps.seen[x] += small;
  }
}

// From row y to the one below.
void add_down(const cv::Mat& levels, int y, Steps& steps) {
  const auto* row = levels.ptr<std::int16_t>(y);
  const auto* below = levels.ptr<std::int16_t>(y + 1);
  const auto i = static_cast<std::size_t>(y);
  const int least = steps.least[i], most = steps.most[i];
  int sum = 0, seen = 0;
  for (int x = 0; x < levels.cols; ++x) {
    const int small = is_small(row[x], below[x], least, most);
    sum += small * (below[x] - row[x]);
    seen += small;
  }
  steps.sum[i] = sum;
  steps.seen[i] = seen;
}

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

void learn(std::vector<float>& steps, const Steps& looked, float share) {
  for (std::size_t i = 0; i < steps.size(); ++i) {
    if (looked.seen[i] == 0) continue;
    const float mean = static_cast<float>(looked.sum[i]) / static_cast<float>(looked.seen[i]);
    steps[i] += share * (mean - steps[i]);
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
  const float reach = static_cast<float>(config_.edge) * typical_step(levels);
  Steps columns(column_steps_, reach), rows(row_steps_, reach);
  for (int y = 0; y < levels.rows; ++y) {
    add_across(levels.ptr<std::int16_t>(y), columns);
    if (y + 1 < levels.rows) add_down(levels, y, rows);
  }
  looks_ = std::min(looks_ + 1, config_.memory);
  learn(column_steps_, columns, 1 / static_cast<float>(looks_));
  learn(row_steps_, rows, 1 / static_cast<float>(looks_));
}

void StripePattern::doubt() { looks_ = std::min(looks_, config_.kept); }

void StripePattern::scale(float factor) {
  for (float& step : column_steps_) step *= factor;
  for (float& step : row_steps_) step *= factor;
}

void StripePattern::add_to(cv::Mat& image) const {
  if (looks_ == 0) return;
  const float trust = static_cast<float>(looks_) / static_cast<float>(looks_ + config_.trial);
  const std::vector<float> columns = stripes_of(column_steps_, config_.window_px);
  const std::vector<float> rows = stripes_of(row_steps_, config_.window_px);
  for (int y = 0; y < image.rows; ++y) {
    auto* row = image.ptr<std::int16_t>(y);
    const float of_row = rows[static_cast<std::size_t>(y)];
    for (std::size_t x = 0; x < columns.size(); ++x) {
      const float level = static_cast<float>(row[x]) + trust * (of_row + columns[x]);
      row[x] = static_cast<std::int16_t>(level + (level < 0 ? -0.5F : 0.5F));
    }
  }
}

}  // namespace covey
