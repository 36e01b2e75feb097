// SPDX-License-Identifier: Apache-2.0
#include "frontend/block_differences.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>

#include "frontend/white_level.h"
#include "tests/frontend/synthetic_thermal.h"

namespace covey {
namespace {

constexpr double kDeviation = 30;  // grey levels, of the synthetic scene

Sight take(SyntheticThermal& camera) {
  Sight sight;
  const cv::Mat image = camera.expose();
  sight.side_px = square_side(image.size());
  square_means(image, white_level(image), sight.side_px)
      .convertTo(sight.levels, CV_32F, 1 / kDeviation);
  for (const TrackPlace& track : camera.tracks()) {
    sight.tracks.push_back({track.patch_id, track.place.pixel, 0});
  }
  return sight;
}

void advance(SyntheticThermal& camera, int images) {
  for (int i = 0; i < images; ++i) camera.advance();
}

// As seen after a tenth of a second.
std::vector<FieldDifference> compared(SyntheticThermal& camera) {
  const Sight before = take(camera);
  advance(camera, 3);
  return compare_blocks(before, take(camera), BlockConfig{});
}

double at(const cv::Mat& field, const Eigen::Vector2d& p) {
  return field.at<float>(static_cast<int>(p.y()), static_cast<int>(p.x()));
}

TEST(BlockDifferences, AreWhatTheFieldDoesToTheSceneThatMovesUnderIt) {
  SyntheticThermal camera(1);
  const std::vector<FieldDifference> found = compared(camera);
  ASSERT_GT(found.size(), 50U);  // of 80
  const cv::Mat field = camera.field() / kDeviation;
  double error = 0, size = 0;
  for (const FieldDifference& d : found) {
    const double expected = at(field, d.to) - at(field, d.from);
    error += std::pow(d.to_level - d.from_level - expected, 2);
    size += expected * expected;
  }
  EXPECT_LT(error, 0.09 * size);
}

// A tenth of a per cent from each sight to the next would be a tenth after ten seconds.
TEST(BlockDifferences, OfASceneWithoutFieldHaveNoGain) {
  SyntheticThermal camera(2);
  camera.field_sigma = 0;
  double to = 0, from = 0;
  for (int k = 0; k < 20; ++k) {
    const std::vector<FieldDifference> found = compared(camera);
    double mean_from = 0, mean_to = 0;
    for (const FieldDifference& d : found) {
      mean_from += d.from_level / static_cast<double>(found.size());
      mean_to += d.to_level / static_cast<double>(found.size());
    }
    for (const FieldDifference& d : found) {
      to += (d.to_level - mean_to) * (d.to_level - mean_to);
      from += (d.from_level - mean_from) * (d.from_level - mean_from);
    }
  }
  EXPECT_NEAR(std::sqrt(to / from), 1, 2e-3);
}

TEST(BlockDifferences, ReachTheBordersWhereNoTrackIs) {
  SyntheticThermal camera(3);
  const std::vector<FieldDifference> found = compared(camera);
  const auto outside = [](const FieldDifference& d) {
    return d.to.x() < 24 || d.to.y() < 24 || d.to.x() > SyntheticThermal::kWidth - 24 ||
           d.to.y() > SyntheticThermal::kHeight - 24;
  };
  EXPECT_GT(std::count_if(found.begin(), found.end(), outside), 8);
}

TEST(BlockDifferences, SaturatedPixelsAreNotCompared) {
  SyntheticThermal camera(4);
  camera.saturated_half = true;
  for (const FieldDifference& d : compared(camera)) {
    EXPECT_GT(std::min(d.from.x(), d.to.x()), SyntheticThermal::kWidth / 2.0);
  }
}

TEST(BlockDifferences, TooFewTracksOrNoSightBeforeShowNothing) {
  SyntheticThermal camera(5);
  Sight before = take(camera);
  advance(camera, 3);
  const Sight now = take(camera);
  EXPECT_TRUE(compare_blocks(Sight{}, now, BlockConfig{}).empty());
  before.tracks.resize(11);
  EXPECT_TRUE(compare_blocks(before, now, BlockConfig{}).empty());
}

TEST(BlockDifferences, TracksInOnePlaceAreBorne) {
  SyntheticThermal camera(6);
  Sight before = take(camera);
  advance(camera, 3);
  Sight now = take(camera);
  for (TrackGrey& track : before.tracks) track.pixel = {100, 100};
  for (TrackGrey& track : now.tracks) track.pixel = {100, 100};
  for (const FieldDifference& d : compare_blocks(before, now, BlockConfig{})) {
    EXPECT_TRUE(std::isfinite(d.to_level - d.from_level) && d.noise > 0);
  }
}

TEST(BlockDifferences, SquaresAreMeansAndHaveNoneWithABlackOrWhitePixel) {
  cv::Mat image(8, 12, CV_8UC1, cv::Scalar(100));
  image.at<std::uint8_t>(1, 5) = 116;
  image.at<std::uint8_t>(6, 1) = 0;
  image.at<std::uint8_t>(7, 11) = 255;
  const cv::Mat means = square_means(image, white_level(image), 4);
  ASSERT_EQ(means.size(), cv::Size(3, 2));
  EXPECT_EQ(means.at<float>(0, 0), 100);
  EXPECT_EQ(means.at<float>(0, 1), 101);
  EXPECT_TRUE(std::isnan(means.at<float>(1, 0)));
  EXPECT_TRUE(std::isnan(means.at<float>(1, 2)));
  cv::Mat wide(4, 4, CV_16UC1, cv::Scalar(29500));
  EXPECT_EQ(square_means(wide, white_level(wide), 4).at<float>(0, 0), 29500);
}

TEST(BlockDifferences, SquaresAreAsWideAsTheImageAllows) {
  EXPECT_EQ(square_side({640, 512}), 4);
  EXPECT_EQ(square_side({320, 256}), 2);
  EXPECT_EQ(square_side({160, 120}), 1);
  EXPECT_EQ(square_side({80, 60}), 1);
}

TEST(BlockDifferences, SquaresThatAMaskTouchesHaveNoMean) {
  const cv::Mat image(8, 12, CV_8UC1, cv::Scalar(100));
  cv::Mat mask(8, 12, CV_8UC1, cv::Scalar(255));
  mask.at<std::uint8_t>(3, 8) = 0;
  const cv::Mat means = square_means(image, white_level(image), 4, shown_squares(mask, 4));
  EXPECT_TRUE(std::isnan(means.at<float>(0, 2)));
  EXPECT_EQ(cv::countNonZero(means == 100), 5);
  EXPECT_TRUE(shown_squares(cv::Mat(), 4).empty());
}

TEST(BlockDifferences, ASensorOfFourteenBitsSaturatesBelowItsImagesWhite) {
  cv::Mat image(4, 8, CV_16UC1, cv::Scalar(9000));
  image.at<std::uint16_t>(2, 6) = 16383;
  const cv::Mat means = square_means(image, white_level(image), 4);
  EXPECT_EQ(means.at<float>(0, 0), 9000);
  EXPECT_TRUE(std::isnan(means.at<float>(0, 1)));
  image.at<std::uint16_t>(2, 6) = 16000;  // merely bright
  EXPECT_EQ(square_means(image, white_level(image), 4).at<float>(0, 1), 9437.5F);
}

}  // namespace
}  // namespace covey
