// SPDX-License-Identifier: Apache-2.0
//
// A peer's landmarks as the own drone sees them, where the two worlds do not agree.
#pragma once

#include <Eigen/Geometry>
#include <random>
#include <vector>

#include "frontend/geometric_verification.h"
#include "synthetic_places.h"

namespace covey::testing {

constexpr double kPinholeFocal = 455;  // px

inline CameraIntrinsics pinhole() {
  CameraIntrinsics camera;
  camera.fx = camera.fy = kPinholeFocal;
  return camera;
}

// A peer whose world is off by a known yaw and translation, seen by a camera that is not level.
struct OffsetWorld {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  FrameOffset truth;
  std::vector<Correspondence> matches;
};

inline OffsetWorld offset_world(const FrameOffset& truth, int points, double noise_px,
                                unsigned seed) {
  std::mt19937 random(seed);
  OffsetWorld result;
  result.T_world_cam = level_camera({3, -2, 1}, 0.4);
  result.T_world_cam.linear() =
      result.T_world_cam.linear() * Eigen::AngleAxisd(0.2, Eigen::Vector3d(1, 2, 0).normalized());
  result.truth = truth;
  const Eigen::Vector3d c = result.T_world_cam.translation();
  for (int i = 0; i < points; ++i) {
    const Eigen::Vector2d bearing(uniform(-0.7, 0.7, random), uniform(-0.5, 0.5, random));
    const Eigen::Vector3d p_own =
        result.T_world_cam * (uniform(5, 20, random) * bearing.homogeneous());
    const Eigen::Vector2d noise(uniform(-1, 1, random), uniform(-1, 1, random));
    // The inverse of to_own_world.
    const Eigen::Vector3d p_peer =
        c + Eigen::AngleAxisd(-truth.yaw, Eigen::Vector3d::UnitZ()) * (p_own - c - truth.offset);
    result.matches.push_back({p_peer, bearing + noise_px / kPinholeFocal * noise});
  }
  return result;
}

}  // namespace covey::testing
