// SPDX-License-Identifier: Apache-2.0
#include "frontend/orb.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "frontend/place_recognition.h"
#include "synthetic_places.h"

namespace covey {
namespace {

using testing::level_camera;

CameraIntrinsics wide_camera() {
  CameraIntrinsics camera;
  camera.width = 320;
  camera.height = 320;
  camera.fx = camera.fy = 200;
  camera.cx = camera.cy = 160;
  return camera;
}

Eigen::Matrix3d rolled(const Eigen::Matrix3d& R_world_cam, double roll) {
  return R_world_cam * Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

cv::Mat blotches() {
  cv::Mat noise(320, 320, CV_8U);
  cv::RNG random(3);
  random.fill(noise, cv::RNG::UNIFORM, 0, 255);
  cv::GaussianBlur(noise, noise, {}, 3);
  cv::normalize(noise, noise, 0, 255, cv::NORM_MINMAX);
  return noise;
}

TEST(WorldDirections, DownIsDownInALevelImageAndTurnsWithARolledCamera) {
  const Eigen::Matrix3d level = level_camera({0, 0, 0}, 0.7).linear();
  const std::vector<Eigen::Vector2d> centre{{0, 0}};
  EXPECT_NEAR(world_directions_deg(wide_camera(), centre, level)[0], 90, 1e-3);
  // A camera that rolls clockwise, seen from behind, sees the world turn the other way.
  EXPECT_NEAR(world_directions_deg(wide_camera(), centre, rolled(level, 0.5))[0],
              90 - 0.5 * 180 / M_PI, 1e-3);
}

TEST(WorldDirections, ACameraThatLooksDownTakesTheWorldsXAxis) {
  Eigen::Matrix3d R_world_cam;  // x right = world x, y down = -world y, z forward = -world z
  R_world_cam << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  for (const Eigen::Vector2d& bearing : {Eigen::Vector2d(0, 0), Eigen::Vector2d(0.5, -0.3)}) {
    EXPECT_NEAR(world_directions_deg(wide_camera(), {bearing}, R_world_cam)[0], 0, 1e-3);
  }
}

TEST(WorldDirections, FollowTheLensDistortion) {
  CameraIntrinsics camera = wide_camera();
  camera.distortion = {-0.25, 0.05, 0, 0};
  const Eigen::Matrix3d R_world_cam = level_camera({0, 0, 0}).linear();
  const Eigen::Vector2d bearing(0.4, 0.3), lower(0.4, 0.301);  // down moves along bearing y here
  const Eigen::Vector2d moved = project(camera, lower) - project(camera, bearing);
  EXPECT_NEAR(world_directions_deg(camera, {bearing}, R_world_cam)[0],
              std::atan2(moved.y(), moved.x()) * 180 / M_PI, 0.1);
}

TEST(DescribePlaces, TheSameCornerFromARolledCameraHasTheSameDescriptor) {
  const double roll = 0.6;
  const cv::Mat image = blotches();
  cv::Mat turned;  // what a camera sees that rolled clockwise: the image turned counter-clockwise
  cv::warpAffine(image, turned, cv::getRotationMatrix2D({160, 160}, roll * 180 / M_PI, 1), {});
  const Eigen::Matrix3d R_world_cam = level_camera({0, 0, 0}).linear();
  const auto describe = [](const cv::Mat& pixels, const Eigen::Matrix3d& attitude) {
    const std::vector<Eigen::Vector2d> centre{{160, 160}};
    const auto directions = world_directions_deg(wide_camera(), {{0, 0}}, attitude);
    return describe_places(pixels, centre, directions)[0].value();
  };
  const BinaryDescriptor first = describe(image, R_world_cam);
  EXPECT_LT(hamming_distance(first, describe(turned, rolled(R_world_cam, roll))), 30);
  EXPECT_GT(hamming_distance(first, describe(turned, R_world_cam)), 60);
}

TEST(DescribePlaces, NothingTooNearToTheEdge) {
  const auto descriptors =
      describe_places(blotches(), {{5, 160}, {160, 160}, {160, 316}}, {0.0f, 0.0f, 0.0f});
  EXPECT_FALSE(descriptors[0].has_value());
  EXPECT_TRUE(descriptors[1].has_value());
  EXPECT_FALSE(descriptors[2].has_value());
}

}  // namespace
}  // namespace covey
