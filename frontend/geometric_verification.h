// SPDX-License-Identifier: Apache-2.0
//
// Which of the own features and a peer's landmarks that are said to be the same points are so, by
// geometry. Both drones know gravity, so that yaw and translation are all that can differ between
// their worlds, and two points fix it (Kukelova et al., "Closed-form solutions to minimal absolute
// pose problems with known vertical direction", 2010).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <optional>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/camera.h"

namespace covey {

// What takes points from the peer's world to the own one, about the own camera's position c:
// p_own = c + offset + Rz(yaw) (p_peer - c). Zero when both share one frame and do not drift.
struct FrameOffset {
  double yaw = 0;                                    // rad
  Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // m
};

struct VerificationConfig {
  double inlier_px = 3.0;  // reprojection error
  int min_inliers = 6;
  double min_inlier_share = 0.25;  // of the descriptor matches
  int max_iterations = 300;
  double max_offset_sigma = 0.5;  // m, left by the inliers at 1 px: points on one spot fix nothing
  // The drones start in one frame, or it is known how their frames lie: what is left is drift.
  double max_offset = 3.0;  // m
  double max_yaw = 0.1;     // rad
};

// A peer's landmark and the own bearing that is said to be the same point.
struct Correspondence {
  Eigen::Vector3d p_world_peer = Eigen::Vector3d::Zero();  // m, in the peer's world
  Eigen::Vector2d bearing_own = Eigen::Vector2d::Zero();   // (x/z, y/z) in the own cam
};

[[nodiscard]] Eigen::Vector3d to_own_world(const FrameOffset& offset, const Eigen::Vector3d& c,
                                           const Eigen::Vector3d& p_world_peer);

// The offsets, at most two, that put two landmarks on their bearings in front of the own camera.
[[nodiscard]] std::vector<FrameOffset> offsets_from_two_points(const Eigen::Isometry3d& T_world_cam,
                                                               const Correspondence& first,
                                                               const Correspondence& second);

struct Verified {
  FrameOffset offset;
  std::vector<std::size_t> inliers;  // indices of the correspondences, rising
};

enum class VerificationFailure {
  kTooFewCorrespondences,
  kTooFewInliers,
  kUndetermined,
  kOffsetTooLarge
};

struct VerificationResult {
  std::optional<Verified> verified;
  VerificationFailure failure = VerificationFailure::kTooFewCorrespondences;  // if not verified
};

// RANSAC over two points, then least squares on the inliers. Same input, same output.
[[nodiscard]] VerificationResult verify(const Eigen::Isometry3d& T_world_cam,
                                        const std::vector<Correspondence>& correspondences,
                                        const CameraIntrinsics& camera,
                                        const VerificationConfig& config);

}  // namespace covey
