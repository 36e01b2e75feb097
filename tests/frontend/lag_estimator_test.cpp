// SPDX-License-Identifier: Apache-2.0
#include "frontend/lag_estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "frontend/image_pyramid.h"
#include "frontend/patch_alignment.h"
#include "tests/frontend/synthetic_lag.h"

namespace covey {
namespace {

PixelLagConfig expecting(double time_constant_s) {
  PixelLagConfig config;
  config.time_constant_s = time_constant_s;
  config.shift_sigma_px = 0.5;  // nothing is shared or lasts between images that are drawn anew
  return config;
}

// Patches cut from the first image and found in the others, each of the scene at another speed.
double estimated(const PixelLagConfig& config, double true_s, double speed) {
  AlignmentConfig alignment;
  alignment.compare_scales = true;
  const cv::Mat texture = scene();
  PixelLag lag(lagging_camera());
  LagEstimator estimator(config);
  std::vector<std::pair<TrackPlace, Patch>> patches;
  constexpr int kImages = 12;
  for (int k = 0; k < kImages; ++k) {
    const Eigen::Vector2d velocity(speed * std::cos(0.7 * k), speed * std::sin(0.5 * k));
    lag.set_motion({}, moving(velocity));
    const cv::Mat grey =
        lag.taken_out(seen(texture, velocity, true_s), estimator.time_constant_s());
    const ImagePyramid image = build_pyramid(grey, 2);
    std::vector<TrackPlace> tracks;
    for (int y = 40; k == 0 && y <= kHeight - 40; y += 20) {
      for (int x = 40; x <= kWidth - 40; x += 20) {
        TrackPlace track;
        track.patch_id = patches.size();
        track.place.pixel = {x, y};
        if (auto patch = Patch::cut(image, track.place.pixel, alignment)) {
          patches.emplace_back(track, *std::move(patch));
        }
      }
    }
    for (const auto& [track, patch] : patches) {
      const auto found = patch.align(image, track.place, 2, alignment);
      if (!found) continue;
      tracks.push_back(
          {track.patch_id, found->place, velocity, k == 0 ? std::nullopt : found->coarse_shift});
    }
    EXPECT_GT(tracks.size(), 80U);
    estimator.learn(nanoseconds(1 + k / 30.0), tracks, lag);
  }
  return estimator.time_constant_s();
}

TEST(LagEstimator, FindsTheLagWhateverItIsToldAtFirst) {
  EXPECT_NEAR(estimated(expecting(0.008), 0.004, 250), 0.004, 0.0015);
  EXPECT_NEAR(estimated(expecting(0.012), 0.008, 250), 0.008, 0.0015);
  EXPECT_NEAR(estimated(expecting(0.008), 0.012, 250), 0.012, 0.0015);
}

TEST(LagEstimator, PixelsWithoutLagAreLeftAlone) {
  EXPECT_LT(estimated(expecting(0.008), 1e-6, 250), 0.003);
}

TEST(LagEstimator, KnownLagStays) {
  PixelLagConfig config = expecting(0.008);
  config.sigma_s = 0;
  EXPECT_EQ(estimated(config, 0.004, 250), 0.008);
}

TEST(LagEstimator, WhatHardlyMovesTellsNothing) {
  EXPECT_NEAR(estimated(expecting(0.008), 0.004, 10), 0.008, 0.0005);
}

}  // namespace
}  // namespace covey
