// SPDX-License-Identifier: Apache-2.0
#include "frontend/camera.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <limits>

#include "euroc_camera.h"

namespace covey {
namespace {

using testing::euroc_camera;

// A wide lens as Kalibr describes it.
CameraIntrinsics equidistant_camera() {
  CameraIntrinsics camera = euroc_camera();
  camera.model = DistortionModel::kEquidistant;
  camera.fx = 300;
  camera.fy = 301;
  camera.distortion = {-0.012, 0.02, -0.015, 0.003};
  return camera;
}

class CameraModel : public ::testing::TestWithParam<CameraIntrinsics> {};

INSTANTIATE_TEST_SUITE_P(Both, CameraModel,
                         ::testing::Values(euroc_camera(), equidistant_camera()));

TEST_P(CameraModel, UnprojectUndoesProjectAllOverTheImage) {
  const CameraIntrinsics camera = GetParam();
  for (int v = 0; v < camera.height; v += 16) {
    for (int u = 0; u < camera.width; u += 16) {
      const Eigen::Vector2d pixel(u, v);
      const auto bearing = unproject(camera, pixel);
      ASSERT_TRUE(bearing.has_value()) << pixel.transpose();
      EXPECT_LT((project(camera, *bearing) - pixel).norm(), 1e-8) << pixel.transpose();
    }
  }
}

// A pixel stays where it is; its bearing is another one with other intrinsics.
TEST_P(CameraModel, WhatIntrinsicsDoToABearingMatchesCentralDifferences) {
  const CameraIntrinsics camera = GetParam();
  constexpr double kStep = 1e-6;
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(camera.cx, camera.cy),
                                       Eigen::Vector2d(30, 20), Eigen::Vector2d(700, 300)}) {
    const auto bearing = unproject(camera, pixel);
    ASSERT_TRUE(bearing);
    const auto J = bearing_by_intrinsics(camera, *bearing);
    for (int i = 0; i < kIntrinsicsSize; ++i) {
      const IntrinsicsError error = kStep * IntrinsicsError::Unit(i);
      const auto more = unproject(corrected(camera, error), pixel);
      const auto less = unproject(corrected(camera, -error), pixel);
      ASSERT_TRUE(more && less);
      // What was computed is wrong by that much when the true intrinsics are the corrected ones.
      EXPECT_LT((J.col(i) + (*more - *less) / (2 * kStep)).norm(), 1e-5) << pixel.transpose();
    }
  }
}

TEST_P(CameraModel, JacobianMatchesCentralDifferences) {
  const CameraIntrinsics camera = GetParam();
  constexpr double kStep = 1e-6;
  for (const Eigen::Vector2d& bearing :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(3e-5, -2e-5), Eigen::Vector2d(1.01e-4, 0),
        Eigen::Vector2d(0.3, -0.2), Eigen::Vector2d(-0.7, 0.4)}) {
    Eigen::Matrix2d J;
    const Eigen::Vector2d pixel = project(camera, bearing, &J);
    ASSERT_TRUE(pixel.allFinite());
    for (int axis = 0; axis < 2; ++axis) {
      const Eigen::Vector2d step = kStep * Eigen::Vector2d::Unit(axis);
      const Eigen::Vector2d numeric =
          (project(camera, bearing + step) - project(camera, bearing - step)) / (2 * kStep);
      EXPECT_LT((J.col(axis) - numeric).norm(), 1e-5) << bearing.transpose();
    }
  }
}

TEST_P(CameraModel, PrincipalPointLooksStraightAhead) {
  const CameraIntrinsics camera = GetParam();
  const auto bearing = unproject(camera, {camera.cx, camera.cy});
  ASSERT_TRUE(bearing.has_value());
  EXPECT_LT(bearing->norm(), 1e-12);
}

TEST(Camera, FisheyePixelsBeyondTheHalfSpaceHaveNoBearing) {
  const CameraIntrinsics camera = equidistant_camera();
  for (const double distance : {2000.0, 10000.0, 1e9}) {
    EXPECT_FALSE(unproject(camera, {camera.cx + distance, camera.cy}).has_value()) << distance;
    EXPECT_FALSE(unproject(camera, {camera.cx, camera.cy - distance}).has_value()) << distance;
  }
}

TEST_P(CameraModel, PixelsThatAreNotNumbersHaveNoBearing) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(unproject(GetParam(), {nan, 10}).has_value());
}

TEST(Camera, BarrelDistortionNeverReturnsItsSecondBranch) {
  // r (1 - 0.3 r^2) grows up to r = 1.054 (0.7027 distorted) and comes back to 0 at r = 1.826.
  CameraIntrinsics camera = euroc_camera();
  camera.distortion = {-0.3, 0, 0, 0};
  const auto inside = unproject(camera, {camera.cx + 0.702 * camera.fx, camera.cy});
  ASSERT_TRUE(inside.has_value());
  EXPECT_LT(inside->x(), 1.0541);
  EXPECT_FALSE(unproject(camera, {camera.cx + 0.704 * camera.fx, camera.cy}).has_value());
}

TEST(Camera, WhatLiesBeyondWhereTheDistortionTurnsBackIsNotOnTheLens) {
  CameraIntrinsics camera = euroc_camera();
  camera.distortion = {-0.3, 0, 0, 0};
  EXPECT_TRUE(is_on_lens(camera, {1.05, 0}));
  for (const double r : {1.06, 1.5, 1.8, 2.5}) EXPECT_FALSE(is_on_lens(camera, {0, r})) << r;
  EXPECT_TRUE(is_in_image(camera, project(camera, {0, 1.8}))) << "though its pixel is in the image";
  camera.distortion = {};
  EXPECT_TRUE(is_on_lens(camera, {3, 0}));
  camera.model = DistortionModel::kEquidistant;
  camera.distortion = {-0.4, 0, 0, 0};  // turns back at 0.913 rad
  EXPECT_TRUE(is_on_lens(camera, {std::tan(0.9), 0}));
  EXPECT_FALSE(is_on_lens(camera, {std::tan(0.93), 0}));
}

TEST(Camera, OpenCvOrderOfRadialTangentialCoefficients) {
  // By hand: x = 0.1, y = 0.2, r2 = 0.05, radial = 1 - 0.3*0.05 + 0.1*0.0025 = 0.98525.
  // x' = 0.1 * 0.98525 + 2*0.01*0.02 + 0.02*(0.05 + 0.02) = 0.100325
  // y' = 0.2 * 0.98525 + 0.01*(0.05 + 0.08) + 2*0.02*0.02 = 0.19915
  CameraIntrinsics camera;
  camera.fx = camera.fy = 1;
  camera.distortion = {-0.3, 0.1, 0.01, 0.02};
  const Eigen::Vector2d pixel = project(camera, {0.1, 0.2});
  EXPECT_NEAR(pixel.x(), 0.100325, 1e-12);
  EXPECT_NEAR(pixel.y(), 0.19915, 1e-12);
}

}  // namespace
}  // namespace covey
