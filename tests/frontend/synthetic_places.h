// SPDX-License-Identifier: Apache-2.0
//
// Places without images, for the tests: landmarks with random descriptors, seen by cameras of known
// pose, with bits that flip from one view to the next.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <random>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/tracker.h"

namespace covey::testing {

inline BinaryDescriptor random_descriptor(std::mt19937& random) {
  BinaryDescriptor descriptor{};
  for (std::uint8_t& byte : descriptor) byte = static_cast<std::uint8_t>(random());
  return descriptor;
}

// Exactly `bits` draws of a bit to flip; a bit drawn twice flips back.
inline BinaryDescriptor with_noise(BinaryDescriptor descriptor, int bits, std::mt19937& random) {
  for (int i = 0; i < bits; ++i) {
    const auto bit = random() % 256;
    descriptor[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
  }
  return descriptor;
}

inline double uniform(double low, double high, std::mt19937& random) {
  return low + (high - low) * static_cast<double>(random() % 1000000) / 1e6;
}

struct ScenePoint {
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();
  BinaryDescriptor descriptor{};
};

using Scene = std::vector<ScenePoint>;

// In a box of 12 m x 8 m x 8 m about `centre`.
inline Scene make_scene(int points, const Eigen::Vector3d& centre, unsigned seed) {
  std::mt19937 random(seed);
  Scene scene;
  for (int i = 0; i < points; ++i) {
    const Eigen::Vector3d p(uniform(-4, 4, random), uniform(-6, 6, random), uniform(-4, 4, random));
    scene.push_back({centre + p, random_descriptor(random)});
  }
  return scene;
}

// Camera at `p_world_cam`, looking level along world x, turned left by `yaw`.
inline Eigen::Isometry3d level_camera(const Eigen::Vector3d& p_world_cam, double yaw = 0) {
  Eigen::Matrix3d R_level;
  R_level << 0, 0, 1, -1, 0, 0, 0, -1, 0;  // columns: right, down and forward in the world
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  T_world_cam.linear() = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * R_level;
  T_world_cam.translation() = p_world_cam;
  return T_world_cam;
}

struct ViewNoise {
  int descriptor_bits = 10;
  double bearing = 0.5 / 455;
};

// Scene point i is track `first_id + i`.
inline TrackedFrame view(const Scene& scene, const Eigen::Isometry3d& T_world_cam, TimeNs stamp_ns,
                         std::uint64_t first_id, const ViewNoise& noise, unsigned seed) {
  std::mt19937 random(seed);
  TrackedFrame frame;
  frame.stamp_ns = stamp_ns;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    const Eigen::Vector3d p_cam = T_world_cam.inverse() * scene[i].p_world;
    if (p_cam.z() < 0.5 || p_cam.hnormalized().cwiseAbs().maxCoeff() > 0.8) continue;
    TrackedFeature feature;
    feature.track_id = first_id + i;
    feature.bearing =
        p_cam.hnormalized() +
        Eigen::Vector2d(uniform(-1, 1, random), uniform(-1, 1, random)) * noise.bearing;
    feature.covariance = noise.bearing * noise.bearing * Eigen::Matrix2d::Identity();
    feature.descriptor = with_noise(scene[i].descriptor, noise.descriptor_bits, random);
    feature.described = true;
    frame.features.push_back(feature);
  }
  return frame;
}

// What the filter of a drone knows of the scene's depths, seen from `T_world_cam`; `share` of the
// depth is their standard deviation and their largest error.
inline std::vector<TrackDepth> depths(const Scene& scene, const Eigen::Isometry3d& T_world_cam,
                                      std::uint64_t first_id, double share, unsigned seed) {
  std::mt19937 random(seed);
  std::vector<TrackDepth> known;
  for (std::size_t i = 0; i < scene.size(); ++i) {
    const double depth = (T_world_cam.inverse() * scene[i].p_world).z();
    if (depth < 0.5) continue;
    const double inverse = (1 + share * uniform(-1, 1, random)) / depth;
    known.push_back({first_id + i, inverse, share * inverse});
  }
  return known;
}

}  // namespace covey::testing
