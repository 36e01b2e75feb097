// SPDX-License-Identifier: Apache-2.0
//
// Pinhole camera with radial-tangential (Brown-Conrady) or equidistant (Kannala-Brandt) distortion,
// four coefficients each, as in EuRoC sensor.yaml and Kalibr. Pixel (0, 0) is the centre of the
// top-left pixel. `bearing` is (x/z, y/z) in cam.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "estimator/measurements.h"

namespace covey {

enum class DistortionModel { kRadialTangential, kEquidistant };

struct CameraIntrinsics {
  int width = 0, height = 0;              // pixels
  double fx = 0, fy = 0, cx = 0, cy = 0;  // pixels
  DistortionModel model = DistortionModel::kRadialTangential;
  std::array<double, 4> distortion{0, 0, 0, 0};  // k1 k2 p1 p2, or k1 k2 k3 k4
};

[[nodiscard]] inline double mean_focal_length_px(const CameraIntrinsics& camera) {
  return (camera.fx + camera.fy) / 2;
}

// Pixel of a bearing, with d(pixel)/d(bearing), 2x2, if asked for.
[[nodiscard]] Eigen::Vector2d project(const CameraIntrinsics& camera,
                                      const Eigen::Vector2d& bearing,
                                      Eigen::Matrix2d* J_pixel_bearing = nullptr);

// d(pixel)/d(bearing), 2x2: a wide lens gives a bearing at the edge fewer pixels than one ahead.
[[nodiscard]] Eigen::Matrix2d px_per_bearing(const CameraIntrinsics& camera,
                                             const Eigen::Vector2d& bearing);

// Covariance of a bearing, from that of its pixel, px^2.
[[nodiscard]] Eigen::Matrix2d bearing_covariance(const CameraIntrinsics& camera,
                                                 const Eigen::Vector2d& bearing,
                                                 const Eigen::Matrix2d& pixel_covariance);

// By how much a bearing is wrong that was computed with these intrinsics, by what they lack.
[[nodiscard]] BearingByIntrinsics bearing_by_intrinsics(const CameraIntrinsics& camera,
                                                        const Eigen::Vector2d& bearing);
// Intrinsics that were wrong by so much.
[[nodiscard]] CameraIntrinsics corrected(CameraIntrinsics camera, const IntrinsicsError& error);

// A distortion polynomial that turns back puts a bearing from far outside into the image as well:
// false for those, whose pixel is another bearing's.
[[nodiscard]] bool is_on_lens(const CameraIntrinsics& camera, const Eigen::Vector2d& bearing);

// Not for a pixel that is no number.
[[nodiscard]] inline bool is_in_image(const CameraIntrinsics& camera, const Eigen::Vector2d& pixel,
                                      double margin_px = 0) {
  return pixel.x() >= margin_px && pixel.x() < camera.width - margin_px && pixel.y() >= margin_px &&
         pixel.y() < camera.height - margin_px;
}

// Bearing of a pixel by Newton's method; nothing where the distortion cannot be inverted.
[[nodiscard]] std::optional<Eigen::Vector2d> unproject(const CameraIntrinsics& camera,
                                                       const Eigen::Vector2d& pixel);

}  // namespace covey
