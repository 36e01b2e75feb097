// SPDX-License-Identifier: Apache-2.0
//
// Where an own keyframe's camera stands, seen from another keyframe's: own bearings of landmarks
// whose bearings and depths the other one knows. Where the own drone has measured depths of its
// own, also how they compare with the other's.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>

#include "estimator/measurements.h"

namespace covey {

// Depths are as wrong as odometry is over the way on which they were measured. Two drones' depths
// of the same landmarks tell by how much more the one is wrong than the other.
struct DepthRatio {
  double log_ratio = 0;  // of the other's depths to the own ones
  double variance = 1;
  Vector6d covariance_with_pose = Vector6d::Zero();  // with [dp dtheta]
};

struct RelativePose {
  std::string drone;          // whose keyframe `other` is
  KeyframePose own, other;    // each in its drone's world
  double own_mean_depth = 1;  // m, of what the own keyframe sees
  // Over the way from here to the keyframe its drone has measured depths: if odometry has it too
  // short by some share, so are they.
  KeyframePose own_before, other_before;
  // The other drone has found own landmarks in its image, and tells what came of it. The way
  // between the cameras is as much too short as the depths of what was found: own ones then, else
  // the other's.
  bool found_by_other = false;
  Eigen::Isometry3d T_other_own = Eigen::Isometry3d::Identity();  // camera to camera
  // Of [dp dtheta], both in the other camera's axes: R = Exp(dtheta) R^. What gravity says is not
  // in it: directions that the landmarks leave open are as uncertain as they are. What depths that
  // were measured without a way (not is_depth_baseline) may be wrong together is in it.
  Matrix6d covariance = Matrix6d::Identity();
  int inliers = 0;
  std::optional<DepthRatio> depth_ratio;
};

// From what was found in the image, if that is enough, else from the corners that both drones
// track. Reweighted least squares over all six degrees of freedom from `match.T_other_own`. Nothing
// when fewer than `min_inliers` matches agree or they do not fix the pose.
[[nodiscard]] std::optional<RelativePose> estimate_relative_pose(const KeyframeMatch& match,
                                                                 int min_inliers);

// As the drone is told it whose keyframe was found.
[[nodiscard]] PeerKeyframe as_told(const RelativePose& measurement, const std::string& own_name);

// What a peer has found of the keyframe `own`, which sees what is `own_mean_depth` m away;
// `message.found` must be there.
[[nodiscard]] RelativePose found_by_peer(const PeerKeyframe& message, const KeyframePose& own,
                                         const KeyframePose& own_before, double own_mean_depth);

}  // namespace covey
