// SPDX-License-Identifier: Apache-2.0
#include "frontend/corner_grid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "tests/frontend/synthetic_view.h"

namespace covey {
namespace {

cv::Mat textured_image() {
  cv::Mat image;
  testing_view::random_texture(384, 5)(cv::Rect(0, 0, 320, 240)).convertTo(image, CV_8U);
  return image;
}

TEST(CornerGrid, FillsAnEmptyImageEvenly) {
  CornerGrid grid(CornerConfig(), {320, 240}, 60);
  const auto corners = grid.detect(textured_image(), {}, 60);
  EXPECT_GE(corners.size(), 50u);
  EXPECT_LE(corners.size(), 60u);
  std::set<int> occupied;
  for (const Eigen::Vector2d& corner : corners) {
    occupied.insert(static_cast<int>(corner.y() / 60) * 5 + static_cast<int>(corner.x() / 64));
  }
  EXPECT_EQ(occupied.size(), 20u);
}

TEST(CornerGrid, KeepsItsDistanceFromTracksAndEdges) {
  CornerConfig config;
  CornerGrid grid(config, {320, 240}, 80);
  const cv::Mat image = textured_image();
  const auto first = grid.detect(image, {}, 40);
  const auto second = grid.detect(image, first, 40);
  ASSERT_GE(second.size(), 10u);
  for (const Eigen::Vector2d& corner : second) {
    for (const Eigen::Vector2d& track : first) {
      // Sub-pixel refinement may still move a corner by a few pixels.
      EXPECT_GT((corner - track).norm(), config.min_distance - 6);
    }
    EXPECT_GT(corner.minCoeff(), config.border - 6);
    EXPECT_LT(corner.x(), 320 - config.border + 6);
    EXPECT_LT(corner.y(), 240 - config.border + 6);
  }
}

TEST(CornerGrid, FillsTheHoleThatTracksLeft) {
  CornerGrid grid(CornerConfig(), {320, 240}, 60);
  const cv::Mat image = textured_image();
  std::vector<Eigen::Vector2d> tracks = grid.detect(image, {}, 60);
  std::vector<Eigen::Vector2d> left;
  for (const Eigen::Vector2d& track : tracks) {
    if (track.x() < 160) left.push_back(track);
  }
  const auto found = grid.detect(image, left, 20);
  ASSERT_GE(found.size(), 15u);
  const auto in_hole = std::count_if(
      found.begin(), found.end(), [](const Eigen::Vector2d& corner) { return corner.x() > 140; });
  // A few cells of the other half were left empty by the first call.
  EXPECT_GE(in_hole, static_cast<std::ptrdiff_t>(found.size() * 3 / 4));
}

TEST(CornerGrid, LowersItsThresholdWhereContrastIsLow) {
  cv::Mat image = textured_image(), faint;
  image(cv::Rect(0, 0, 160, 240)).convertTo(faint, CV_8U, 0.15, 100);
  faint.copyTo(image(cv::Rect(0, 0, 160, 240)));
  CornerGrid grid(CornerConfig(), {320, 240}, 60);
  int in_faint_half = 0;
  for (const Eigen::Vector2d& corner : grid.detect(image, {}, 60)) {
    in_faint_half += corner.x() < 150 ? 1 : 0;
  }
  EXPECT_GE(in_faint_half, 15);
}

TEST(CornerGrid, PutsMoreIntoTheCellsThatHaveTextureWhenOthersHaveNone) {
  cv::Mat image = textured_image();
  image(cv::Rect(0, 0, 160, 240)).setTo(80);
  CornerGrid grid(CornerConfig(), {320, 240}, 60);
  std::vector<Eigen::Vector2d> tracks;
  for (int k = 0; k < 5; ++k) {
    const auto found = grid.detect(image, tracks, 60 - static_cast<int>(tracks.size()));
    tracks.insert(tracks.end(), found.begin(), found.end());
  }
  EXPECT_GE(tracks.size(), 45u);  // of about 30 textured cells
}

// Cells are smaller there than the distance between corners else is, and a quarter is border alone.
TEST(CornerGrid, FillsASmallImageWithinAFewLooks) {
  constexpr int kTracks = 200;
  CornerGrid grid(CornerConfig(), {160, 120}, kTracks);
  const cv::Mat image = textured_image()(cv::Rect(0, 0, 160, 120)).clone();
  std::vector<Eigen::Vector2d> tracks;
  const auto look = [&] {
    const int wanted = kTracks - static_cast<int>(tracks.size());
    const auto found = grid.detect(image, tracks, wanted);
    tracks.insert(tracks.end(), found.begin(), found.end());
  };
  look();
  const std::size_t first = tracks.size();
  tracks.resize(first / 2);
  for (int k = 0; k < 2; ++k) look();
  EXPECT_GE(first, 50u);
  EXPECT_GE(tracks.size(), first);
}

TEST(CornerGrid, FindsNothingWhereThereIsNothing) {
  CornerGrid grid(CornerConfig(), {320, 240}, 60);
  EXPECT_TRUE(grid.detect(cv::Mat(240, 320, CV_8U, cv::Scalar(9)), {}, 60).empty());
  EXPECT_TRUE(grid.detect(textured_image(), {}, 0).empty());
}

TEST(CornerGrid, AnImageHardlyLargerThanItsBordersIsNoTrouble) {
  CornerGrid grid(CornerConfig(), {26, 26}, 10);
  cv::Mat image = textured_image()(cv::Rect(0, 0, 26, 26)).clone();
  EXPECT_LE(grid.detect(image, {}, 10).size(), 4u);
}

}  // namespace
}  // namespace covey
