// SPDX-License-Identifier: Apache-2.0
#include "frontend/line_delay_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace covey {
namespace {

CameraIntrinsics camera() {
  return {640, 480, 400, 410, 318, 242, DistortionModel::kRadialTangential, {-0.1, 0.02, 0, 0}};
}

// Sways in front of a scene 3 to 8 m deep.
Eigen::Isometry3d pose_at(double t) {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  T_world_cam.translation() = Eigen::Vector3d(std::sin(1.3 * t), 0.4 * std::cos(1.7 * t), 0);
  T_world_cam.linear() =
      Eigen::AngleAxisd(0.1 * std::sin(2 * t), Eigen::Vector3d(0.3, 1, 0.4).normalized())
          .toRotationMatrix();
  return T_world_cam;
}

Eigen::Vector2d pixel_at(const Eigen::Vector3d& p_world, double t) {
  return project(camera(), (pose_at(t).inverse() * p_world).hnormalized());
}

// What is found after ten seconds in which each line was `true_s` later and `said_s` was known.
std::optional<double> found(double true_s, double said_s, double pixel_sigma = 0.03) {
  std::mt19937 random(3);
  std::normal_distribution<double> gaussian;
  std::uniform_real_distribution<double> uniform(-1, 1);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < 150; ++i) {
    const double depth = 5.5 + 2.5 * uniform(random);
    const double x = 0.6 * depth * uniform(random);
    points.emplace_back(x, 0.45 * depth * uniform(random), depth);
  }
  LineDelayCheck check(camera(), said_s);
  for (int k = 0; k < 300; ++k) {
    const double t = k / 30.0;
    TrackedFrame frame;
    frame.stamp_ns = nanoseconds(1 + t);
    std::vector<TrackDepth> depths;
    for (std::size_t i = 0; i < points.size(); ++i) {
      double later_s = 0;
      for (int round = 0; round < 3; ++round) {
        const double rows = pixel_at(points[i], t + later_s).y() - 0.5 * (camera().height - 1);
        later_s = (true_s - said_s) * rows;
      }
      TrackedFeature feature;
      feature.track_id = 1000 - i;
      feature.pixel = pixel_at(points[i], t + later_s);
      if (!is_in_image(camera(), feature.pixel)) continue;
      feature.pixel.x() += pixel_sigma * gaussian(random);
      feature.pixel.y() += pixel_sigma * gaussian(random);
      frame.features.push_back(feature);
      const double inverse_depth = 1 / (pose_at(t).inverse() * points[i]).z();
      depths.push_back({feature.track_id, inverse_depth, 0.01 * inverse_depth});
    }
    check.add(frame, pose_at(t), check.is_due() ? depths : std::vector<TrackDepth>());
  }
  return check.found_s();
}

TEST(LineDelayCheck, FindsARollingShutterThatNobodyToldOf) {
  const std::optional<double> line_delay_s = found(3e-5, 0);
  ASSERT_TRUE(line_delay_s.has_value());
  EXPECT_NEAR(*line_delay_s, 3e-5, 2e-6);
}

TEST(LineDelayCheck, FindsWhatOneIsLongerThanItWasSaidToBe) {
  const std::optional<double> line_delay_s = found(4e-5, 1.5e-5);
  ASSERT_TRUE(line_delay_s.has_value());
  EXPECT_NEAR(*line_delay_s, 4e-5, 2e-6);
}

TEST(LineDelayCheck, FindsNothingWhereRowsLookWhenTheyAreSaidTo) {
  for (const double pixel_sigma : {0.03, 0.3, 1.0}) {
    EXPECT_FALSE(found(0, 0, pixel_sigma).has_value()) << pixel_sigma;
    EXPECT_FALSE(found(3e-5, 3e-5, pixel_sigma).has_value()) << pixel_sigma;
  }
}

TEST(LineDelayCheck, AsksForDepthsInOneImageOfFive) {
  LineDelayCheck check(camera());
  int due = 0;
  for (int k = 0; k < 50; ++k) {
    due += check.is_due() ? 1 : 0;
    TrackedFrame frame;
    frame.stamp_ns = nanoseconds(1 + k / 30.0);
    check.add(frame, pose_at(0), {});
  }
  EXPECT_EQ(due, 10);
}

}  // namespace
}  // namespace covey
