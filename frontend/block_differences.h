// SPDX-License-Identifier: Apache-2.0
//
// What shows the additive field: blocks from all over the image, followed from one sight to the
// next. Where a block was the tracks around it tell roughly; aligning it in images 160 squares
// across, its mean taken off, tells it well enough for the mean of 8x8 squares. The mean of so many
// pixels has little noise, and there are blocks where there is no corner: at the borders, in the
// sky. The field is as wide as the image, so squares are as well: 4 px of 640, 1 px of 160.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "frontend/spatial_field.h"
#include "frontend/temporal_gain.h"

namespace covey {

struct BlockConfig {
  int fewest_tracks = 12;       // shared by two sights, otherwise they are not compared
  int iterations = 2;           // of aligning a block
  double near_px = 16;          // px: a track that is nearer to a block tells its flow no better,
  double far_px = 120;          // px: one that is farther away hardly
  double flow_sigma_px = 1;     // px, of the place that tracks predict for a block
  double farthest_squares = 2;  // squares from that place, where a block is given up
  double pixel_noise = 0.05;    // of 4x4 px, of the image's standard deviation
  double level_noise = 0.02;    // of the mean of a block that fits perfectly, likewise
  double misfit_noise = 0.3;    // of that mean for each unit of what the texture differs, RMS
};

struct Sight {
  int side_px = 4;                // of a square
  cv::Mat levels;                 // CV_32FC1, mean of each square; NaN: it has none
  std::vector<TrackGrey> tracks;  // by patch
};

// Of the squares of an image, px.
[[nodiscard]] int square_side(cv::Size image);

// CV_8UC1, zero for each square with a pixel that `mask` (as the tracker's) leaves out; empty
// without a mask.
[[nodiscard]] cv::Mat shown_squares(const cv::Mat& mask, int side_px);

// Grey levels, CV_32FC1. A square with a pixel that has no value of its own (black, `white` or
// above), or that is not among those `shown`, has no mean: NaN.
[[nodiscard]] cv::Mat square_means(const cv::Mat& image, int white, int side_px,
                                   const cv::Mat& shown = cv::Mat());

// Half the blocks lie on the grid now, the other half did before, as on a chessboard. A block's
// counterpart is interpolated and so has a little less contrast: were it always the earlier one,
// gain would seem to rise by .7 % from each sight to the next, and the field would follow.
[[nodiscard]] std::vector<FieldDifference> compare_blocks(const Sight& before, const Sight& now,
                                                          const BlockConfig& config);

}  // namespace covey
