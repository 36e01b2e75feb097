// SPDX-License-Identifier: Apache-2.0
#include "frontend/pattern_gain.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace covey {
namespace {

constexpr int kWidth = 640, kHeight = 512, kPlane = 1200;  // px
const cv::Size kImage(kWidth, kHeight);
constexpr int kWhite8 = 255, kWhite16 = 65535;

// Places of a warm plane, one after the other, through a sensor whose pixels and columns are off by
// a little; grey levels when the gain is 1.
class Sensor {
 public:
  double noise = 0.6;
  bool saturated_half = false;

  explicit Sensor(unsigned seed, double pattern_sigma = 0.4) : random_(seed) {
    cv::Mat cells(kPlane / 8, kPlane / 8, CV_32F), columns(1, kWidth, CV_32F);
    random_.fill(cells, cv::RNG::NORMAL, 110, 12);
    cv::resize(cells, plane_, {kPlane, kPlane}, 0, 0, cv::INTER_CUBIC);
    random_.fill(pattern_, cv::RNG::NORMAL, 0, pattern_sigma);
    random_.fill(columns, cv::RNG::NORMAL, 0, pattern_sigma);
    pattern_ += cv::repeat(columns, kHeight, 1);
  }

  // Two bars from top to bottom, which stay where they are however far the camera rises.
  void show_bars() {
    for (const int x : {110, 500}) plane_.colRange(x, x + 12) += 8;
    rises_ = true;
  }

  // CV_8UC1, or 100 counts for each grey level.
  [[nodiscard]] cv::Mat look(double gain, bool wide = false) {
    const int x = rises_ ? 100 : random_.uniform(0, kPlane - kWidth);
    const int y = random_.uniform(0, kPlane - kHeight);
    cv::Mat grain(kImage, CV_32F), image;
    random_.fill(grain, cv::RNG::NORMAL, 0, noise);
    cv::Mat scene = plane_(cv::Rect({x, y}, kImage)) + pattern_ + grain;
    if (saturated_half) scene.colRange(0, kWidth / 2) = 5000;
    scene.convertTo(image, wide ? CV_16U : CV_8U, wide ? 100 * gain : gain);
    return image;
  }

 private:
  cv::RNG random_;
  cv::Mat plane_, pattern_ = cv::Mat(kImage, CV_32F);
  bool rises_ = false;
};

// `told`: what the gain of each look is said to be.
void learn(PatternGain& pattern, Sensor& sensor, int looks = 30, double told = 1) {
  pattern.restart(sensor.look(1), kWhite8, 1);
  for (int i = 0; i < looks; ++i) pattern.look(sensor.look(1), kWhite8, told);
}

TEST(PatternGain, FindsTheGainOfAnImageWithoutATrack) {
  Sensor sensor(1);
  PatternGain pattern{PatternGainConfig{}};
  learn(pattern, sensor);
  for (const double gain : {0.6, 0.8, 1.0, 1.4, 1.8}) {
    const auto found = pattern.measure(sensor.look(gain), kWhite8);
    ASSERT_TRUE(found) << gain;
    EXPECT_NEAR(found->log_gain, -std::log(gain), 0.03) << gain;
  }
}

// A look whose gain was only guessed does not spoil what is told: the first image is the unit.
TEST(PatternGain, ErrorsOfTheLooksGainsDoNotMatter) {
  Sensor sensor(2);
  PatternGain pattern{PatternGainConfig{}};
  learn(pattern, sensor, 30, 1.2);
  const auto found = pattern.measure(sensor.look(1), kWhite8);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->log_gain, 0, 0.03);
}

TEST(PatternGain, KnowsHowCertainItIs) {
  Sensor sensor(3);
  PatternGain pattern{PatternGainConfig{}};
  learn(pattern, sensor);
  for (const double noise : {0.6, 2.0}) {
    sensor.noise = noise;
    double squares = 0;  // of errors, in what is claimed; the first image's is in all of them
    constexpr int kImages = 60;
    double mean = 0;
    for (int i = 0; i < kImages; ++i) {
      const auto found = pattern.measure(sensor.look(1), kWhite8);
      ASSERT_TRUE(found);
      mean += found->log_gain / found->sigma / kImages;
      squares += found->log_gain * found->log_gain / (found->sigma * found->sigma) / kImages;
    }
    EXPECT_GT(squares - mean * mean, 0.4) << noise;
    EXPECT_LT(squares - mean * mean, 1.6) << noise;
  }
}

TEST(PatternGain, SixteenBitsGoTheSameWay) {
  Sensor sensor(4);
  PatternGain pattern{PatternGainConfig{}};
  pattern.restart(sensor.look(1, true), kWhite16, 1);
  for (int i = 0; i < 20; ++i) pattern.look(sensor.look(1, true), kWhite16, 1);
  const auto found = pattern.measure(sensor.look(1.3, true), kWhite16);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->log_gain, -std::log(1.3), 0.02);
}

TEST(PatternGain, SaysNothingBeforeItHasSeenEnough) {
  Sensor sensor(5);
  PatternGain pattern{PatternGainConfig{}};
  pattern.restart(sensor.look(1), kWhite8, 1);
  EXPECT_FALSE(pattern.measure(sensor.look(1), kWhite8));
  for (int i = 0; i < 4; ++i) pattern.look(sensor.look(1), kWhite8, 1);
  EXPECT_FALSE(pattern.measure(sensor.look(1), kWhite8));
  pattern.look(sensor.look(1), kWhite8, 1);
  EXPECT_TRUE(pattern.measure(sensor.look(1), kWhite8));
  pattern.restart(sensor.look(1), kWhite8, 1);
  EXPECT_FALSE(pattern.measure(sensor.look(1), kWhite8));
}

TEST(PatternGain, SaysNothingOfASensorWithoutAPattern) {
  Sensor sensor(6, 0);
  PatternGain pattern{PatternGainConfig{}};
  learn(pattern, sensor, 60);
  int told = 0;
  for (int i = 0; i < 20; ++i) told += pattern.measure(sensor.look(1.3), kWhite8) ? 1 : 0;
  EXPECT_EQ(told, 0);
}

// Bars that slide along themselves look like a pattern, and a strong one. When they are out of
// sight the gain has not fallen.
TEST(PatternGain, EdgesThatSlideAlongThemselvesAreOutvoted) {
  Sensor sensor(7);
  Sensor rising = sensor;
  rising.show_bars();
  PatternGain pattern{PatternGainConfig{}};
  learn(pattern, rising);
  for (int i = 0; i < 5; ++i) {
    const auto found = pattern.measure(sensor.look(1), kWhite8);
    ASSERT_TRUE(found);
    EXPECT_NEAR(found->log_gain, 0, 0.05);
  }
}

TEST(PatternGain, HalfAnImageIsEnough) {
  Sensor sensor(8);
  PatternGain pattern{PatternGainConfig{}};
  learn(pattern, sensor);
  sensor.saturated_half = true;
  const auto found = pattern.measure(sensor.look(1.3), kWhite8);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->log_gain, -std::log(1.3), 0.04);
}

}  // namespace
}  // namespace covey
