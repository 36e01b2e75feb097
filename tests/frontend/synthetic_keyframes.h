// SPDX-License-Identifier: Apache-2.0
//
// Keyframes of level cameras, and what they see of a point.
#pragma once

#include <cstdint>

#include "frontend/keyframe_database.h"
#include "synthetic_places.h"

namespace covey::testing {

inline Keyframe keyframe(std::uint64_t id, const Eigen::Vector3d& p_world_cam) {
  Keyframe result;
  result.pose.keyframe_id = id;
  result.pose.stamp_ns = nanoseconds(static_cast<double>(id));
  result.pose.T_world_cam = level_camera(p_world_cam);
  result.mean_depth = 10;
  return result;
}

inline KeyframeFeature feature(std::uint64_t track, const Eigen::Vector3d& p_world,
                               const Keyframe& from, double relative_sigma) {
  const Eigen::Vector3d p_cam = from.pose.T_world_cam.inverse() * p_world;
  KeyframeFeature result;
  result.track_id = track;
  result.bearing = p_cam.hnormalized();
  result.inverse_depth = 1 / p_cam.z();
  result.inverse_depth_sigma = relative_sigma * result.inverse_depth;
  return result;
}

}  // namespace covey::testing
