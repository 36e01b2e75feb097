// SPDX-License-Identifier: Apache-2.0
//
// Which own features and which landmarks of a peer may be the same points: by descriptor, and, once
// it is known how the peer's world lies, by where they are.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "frontend/geometric_verification.h"
#include "frontend/mutual_matches.h"

namespace covey {

struct MatchingConfig {
  int max_distance_bits = 20;  // of 64
  double ratio = 0.9;          // best distance to second best, in both directions
};

// A mutual best match within the ratio. At most one pair for each index.
[[nodiscard]] std::vector<IndexPair> match_descriptors(const std::vector<ShortDescriptor>& own,
                                                       const std::vector<ShortDescriptor>& peer,
                                                       const MatchingConfig& config);

struct OwnFeature {
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();  // (x/z, y/z) in the own cam
  ShortDescriptor descriptor{};
};

struct PeerPoint {
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();  // m, in the peer's world
  ShortDescriptor descriptor{};
};

struct GuidedConfig {
  double radius_px = 2.0;      // about where the peer's landmark must appear
  int max_distance_bits = 25;  // of 64
};

// Once the offset is known a corner's place tells more than its descriptor: mutual best matches
// among those in reach, without a ratio. At most one pair for each index.
[[nodiscard]] std::vector<IndexPair> match_guided(const Eigen::Isometry3d& T_world_cam,
                                                  const FrameOffset& offset,
                                                  const std::vector<OwnFeature>& own,
                                                  const std::vector<PeerPoint>& peer,
                                                  const CameraIntrinsics& camera,
                                                  const GuidedConfig& config);

// The same without descriptors: mutual nearest ones among those in reach.
[[nodiscard]] std::vector<IndexPair> match_nearest(const Eigen::Isometry3d& T_world_cam,
                                                   const FrameOffset& offset,
                                                   const std::vector<OwnFeature>& own,
                                                   const std::vector<PeerPoint>& peer,
                                                   const CameraIntrinsics& camera,
                                                   const GuidedConfig& config);

}  // namespace covey
