// SPDX-License-Identifier: Apache-2.0
#include "frontend/white_level.h"

#include <gtest/gtest.h>

#include <cstdint>

namespace covey {
namespace {

constexpr int kWhite16 = 65535;

// Grey levels about 20000 with noise of `sigma` counts, as every `step`th value.
cv::Mat noisy_image(double sigma, int step = 1) {
  cv::Mat noise(240, 320, CV_32FC1), image;
  cv::RNG(1).fill(noise, cv::RNG::NORMAL, 20000.0 / step, sigma / step);
  noise.convertTo(image, CV_16UC1);
  return image * step;
}

TEST(WhiteLevel, OfEightBitsIs255) {
  EXPECT_EQ(white_level(cv::Mat(4, 4, CV_8UC1, cv::Scalar(100))), 255);
}

TEST(WhiteLevel, OnePixelIsEnoughWhereAllBitsAreSet) {
  for (const int white : {1023, 4095, 16383, kWhite16}) {
    cv::Mat image = cv::min(noisy_image(300), 1000);
    image.at<std::uint16_t>(7, 5) = static_cast<std::uint16_t>(white);
    EXPECT_EQ(white_level(image), white);
  }
}

TEST(WhiteLevel, ManyPixelsOfTheSameLargestValueAreCutOffThere) {
  for (const int white : {60000, 65532, 65520, 20500}) {
    cv::Mat image = noisy_image(300);
    image.colRange(0, 40) = white;
    EXPECT_EQ(white_level(cv::min(image, white)), white);
  }
}

TEST(WhiteLevel, AScenesBrightestPixelsAreNotCutOff) {
  for (const double sigma : {1.0, 30.0, 3000.0})
    for (const int step : {1, 4, 16}) EXPECT_EQ(white_level(noisy_image(sigma, step)), kWhite16);
}

TEST(WhiteLevel, NorIsAHotPixel) {
  cv::Mat image = noisy_image(300);
  image.at<std::uint16_t>(7, 5) = 61000;
  EXPECT_EQ(white_level(image), kWhite16);
}

// Even as its noise allows, so that it has a brightest and a next value.
TEST(WhiteLevel, NorIsAWarmThing) {
  cv::Mat image = noisy_image(300), thing = noisy_image(3) + 5000;
  thing.colRange(0, 60).copyTo(image.colRange(0, 60));
  EXPECT_EQ(white_level(image), kWhite16);
}

}  // namespace
}  // namespace covey
