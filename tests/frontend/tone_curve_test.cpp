// SPDX-License-Identifier: Apache-2.0
#include "frontend/tone_curve.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

namespace covey {
namespace {

std::vector<int> levels(double mean, double deviation) {
  std::mt19937 random(1);
  std::normal_distribution<double> gaussian(mean, deviation);
  std::vector<int> levels;
  for (int i = 0; i < 5000; ++i)
    levels.push_back(std::clamp(static_cast<int>(gaussian(random)), 0, ToneCurve::kLevels - 1));
  return levels;
}

TEST(ToneCurve, NeverFallsWhateverItSaw) {
  for (const Contrast contrast : {Contrast::kLinear, Contrast::kEqualised}) {
    ToneConfig config;
    config.contrast = contrast;
    ToneCurve curve(config);
    for (const double deviation : {0.5, 30.0, 128.0, 3000.0}) {
      curve.adapt(levels(2048, deviation), 0.5);
      EXPECT_TRUE(std::is_sorted(curve.table().begin(), curve.table().end())) << deviation;
    }
  }
}

// Grey levels of an image whose standard deviation is four of them.
TEST(ToneCurve, KeepsThirtyTwoLevelsApartWhereTheImageHasThem) {
  ToneCurve curve{ToneConfig{}};
  curve.adapt(levels(2048, 128), 0.1);
  for (int level = 2048 - 256; level + 32 <= 2048 + 256; level += 32) {
    EXPECT_GT(curve.table()[static_cast<std::size_t>(level + 32)],
              curve.table()[static_cast<std::size_t>(level)])
        << level;
  }
}

// Levels; the image has a deviation of 128 of them.
TEST(ToneCurve, RisesALittleBeyondTheImageAndIsFlatFromThereOn) {
  ToneCurve curve{ToneConfig{}};
  curve.adapt(levels(2048, 128), 0.1);
  const auto grey = [&](int from_mean) {
    return curve.table()[static_cast<std::size_t>(2048 + from_mean)];
  };
  EXPECT_GT(grey(420), grey(380));
  EXPECT_LT(grey(-420), grey(-380));
  EXPECT_EQ(grey(768), 255);
  EXPECT_EQ(grey(-768), 0);
}

TEST(ToneCurve, FollowsSlowly) {
  ToneCurve curve{ToneConfig{}};
  curve.adapt(levels(2048, 128), 0.1);
  const auto before = curve.table();
  curve.adapt(levels(2300, 128), 1.0 / 30);
  int most = 0;
  for (std::size_t i = 0; i < before.size(); ++i)
    most = std::max(most, std::abs(curve.table()[i] - before[i]));
  EXPECT_LT(most, 20);
}

}  // namespace
}  // namespace covey
