// SPDX-License-Identifier: Apache-2.0
#include "frontend/viewpoint_tolerance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/frontend/euroc_camera.h"

namespace covey {
namespace {

// What a place of this tolerance lets a drone find of landmarks that are all seen under one angle.
void see(ViewpointTolerance& place, double tolerance, double angle, std::size_t landmarks = 1000) {
  const double share = std::exp(-angle / tolerance);
  place.learn(std::vector<double>(landmarks, angle),
              static_cast<std::size_t>(std::lround(share * static_cast<double>(landmarks))));
}

TEST(ViewingAngles, OfLandmarksThatTheOtherCameraSeesAsWell) {
  const CameraIntrinsics camera = testing::euroc_camera();
  Eigen::Isometry3d T_seen_other = Eigen::Isometry3d::Identity();
  T_seen_other.translation().x() = 10;
  T_seen_other.linear() = Eigen::AngleAxisd(-M_PI / 4, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const std::vector<double> angles = viewing_angles(
      {{0, 0, 10}, {5, 0, 5}, {-100, 0, -20}, {10, 0, 0}, {20, 0, -1}, {0, 0, INFINITY}},
      T_seen_other, camera);
  ASSERT_EQ(angles.size(), 2u) << "the others are aside of it, at it, behind it or nowhere";
  EXPECT_NEAR(angles[0], M_PI / 4, 1e-12);
  EXPECT_NEAR(angles[1], M_PI / 2, 1e-12);
}

TEST(ViewingAngles, AreNoneBetweenAViewAndItself) {
  const std::vector<double> angles = viewing_angles(
      {{0, 0, 10}, {1, 1, 5}}, Eigen::Isometry3d::Identity(), testing::euroc_camera());
  ASSERT_EQ(angles.size(), 2u);
  EXPECT_EQ(angles[0], 0);
  EXPECT_EQ(angles[1], 0);
}

TEST(ViewpointTolerance, IsLearnedFromWhatIsFound) {
  for (const double tolerance : {0.3, 0.5, 1.2}) {
    ViewpointTolerance place;
    for (const double angle : {0.1, 0.3, 0.5, 0.4}) see(place, tolerance, angle);
    EXPECT_NEAR(place.tolerance(), tolerance, 0.02 * tolerance);
    EXPECT_NEAR(place.expected_finds({0.0, tolerance}), 1 + std::exp(-1), 0.05);
  }
}

TEST(ViewpointTolerance, ChangesWithThePlace) {
  ViewpointTolerance place;
  for (int i = 0; i < 100; ++i) see(place, 0.4, 0.3);
  for (int i = 0; i < 20; ++i) see(place, 1.0, 0.3);
  EXPECT_NEAR(place.tolerance(), 1.0, 0.1);
}

TEST(ViewpointTolerance, StaysFiniteWhateverIsFound) {
  ViewpointTolerance place;
  place.learn({}, 0);
  place.learn({}, 7);
  for (int i = 0; i < 1000; ++i) {
    place.learn({0.0, 0.0}, 9);  // more than there are, from where they have been seen
    place.learn(std::vector<double>(50, 0.2), i % 2 == 0 ? 50 : 0);
    ASSERT_GT(place.tolerance(), 0.01);
    ASSERT_LT(place.tolerance(), 10);
  }
  EXPECT_EQ(place.expected_finds({}), 0);
}

}  // namespace
}  // namespace covey
