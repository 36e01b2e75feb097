// SPDX-License-Identifier: Apache-2.0
//
// The surroundings of a landmark, small enough to be sent, and found again in another drone's
// image. Two drones that both find a corner set it half a pixel apart; one that looks for what the
// other has seen finds it to a fifth or better. Samples lie on the normalised image plane, so that
// neither drone needs to know the other's lens.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <optional>

#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "frontend/image_pyramid.h"

namespace covey {

struct PatchSearchConfig {
  double spacing_px = 1.6;       // between the samples of a patch
  double max_shift_px = 4.0;     // from where geometry says it is
  double min_correlation = 0.9;  // zero-mean normalised, of what is found with what was sent
};

// What is nearer to the border of an image than that, px, is not found there.
[[nodiscard]] double reach_px(const PatchSearchConfig& config);

// Samples `spacing` apart on the normalised plane about `bearing`. Nothing near the border or
// without contrast.
[[nodiscard]] std::optional<LandmarkPatch> cut_landmark_patch(const cv::Mat& image,
                                                              const CameraIntrinsics& camera,
                                                              const Eigen::Vector2d& bearing,
                                                              double spacing);

// A landmark as another camera has seen it.
struct SeenLandmark {
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
  double inverse_depth = 0;  // 1/m
  const LandmarkPatch* patch = nullptr;
  double spacing = 0;                              // of the patch, normalised plane
  Eigen::Vector3d up = -Eigen::Vector3d::UnitY();  // unit vertical, in the other camera
};

struct FoundPatch {
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
  // Of the bearing, normalised plane, as the alignment has it: what is left of the waves, taken for
  // noise of one and the next, over the texture.
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
};

// Where it is in the own image, by alignment (Lucas and Kanade, 1981) in the waves of the patch,
// warped as a plane that faces the other camera, as level ground or as an upright wall,
// whichever looks most like it; gain and offset of the brightness are free. Nothing where it is out
// of sight, farther off than expected or looks different.
[[nodiscard]] std::optional<FoundPatch> find_landmark_patch(const ImagePyramid& image,
                                                            const CameraIntrinsics& camera,
                                                            const SeenLandmark& seen,
                                                            const Eigen::Isometry3d& T_other_own,
                                                            const PatchSearchConfig& config);

}  // namespace covey
