// SPDX-License-Identifier: Apache-2.0
//
// Which tracks moved as points of a rigid scene do: the rotation between two images is known from
// the gyro, so two tracks give the direction of the translation, and RANSAC finds the one that most
// agree on.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace covey {

struct OutlierConfig {
  // Largest distance to the epipolar line: this many robust standard deviations of this image's
  // distances, but between these limits.
  double max_deviations = 6;
  double min_epipolar_px = 0.3;  // px
  double max_epipolar_px = 2.0;  // px
  double parallax_px = 10;       // images are compared when this far apart in the median, px
  int max_lag = 8;               // but not more images apart than this
  int iterations = 50;           // of RANSAC
  int min_tracks = 10;           // with fewer nothing is rejected
  double min_consensus = 0.5;    // with a smaller part agreeing nothing is rejected
  double gyro_sigma = 0.1;       // rad/s, what the gyro's rotation may be wrong by (its bias)
};

// Bearings, on the z = 1 plane, of one track in two images.
struct BearingPair {
  Eigen::Vector2d before = Eigen::Vector2d::Zero();
  Eigen::Vector2d now = Eigen::Vector2d::Zero();
};

struct TwoViews {
  Eigen::Matrix3d R_now_before = Eigen::Matrix3d::Identity();  // of the camera, from the gyro
  double rotation_sigma = 1e-3;                                // rad, of each axis of it
  double focal_px = 1;                                         // pixels per unit of bearing
};

// One flag for each pair: false where it contradicts the motion of the others. Pure rotation is no
// special case: without parallax every translation explains the tracks that did not move.
[[nodiscard]] std::vector<bool> rigid_scene_inliers(const std::vector<BearingPair>& pairs,
                                                    const TwoViews& views,
                                                    const OutlierConfig& config);

}  // namespace covey
