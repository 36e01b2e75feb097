// SPDX-License-Identifier: Apache-2.0
//
// What a landmark looks like from a clone (paper, eq. 6..8), with derivatives. Two kinds of
// landmark: a point in the world (MSCKF features, projected out again) and a point given by its
// inverse depth in an anchor clone's camera (SLAM features).
#pragma once

#include <Eigen/Core>
#include <optional>

#include "estimator/bearing.h"
#include "estimator/state.h"

namespace covey {

using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Matrix36d = Eigen::Matrix<double, 3, 6>;

// Bearing of a world point seen from an IMU pose; derivatives by [dp dtheta] of the pose, by
// [dp_imu_cam dtheta_imu_cam] and by the point.
struct PointObservation {
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
  bool in_front = false;
  Matrix26d J_pose = Matrix26d::Zero();
  Matrix26d J_extrinsics = Matrix26d::Zero();
  Matrix23d J_point = Matrix23d::Zero();
};
[[nodiscard]] PointObservation observe_point(const Eigen::Vector3d& p_world, const Pose& pose,
                                             const CameraExtrinsics& extrinsics);

// World position of an anchored landmark (paper, eq. 15) and its derivatives.
struct AnchoredPoint {
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();
  Matrix36d J_anchor = Matrix36d::Zero();
  Matrix36d J_extrinsics = Matrix36d::Zero();
  Eigen::Matrix3d J_inverse_depth = Eigen::Matrix3d::Zero();
};
[[nodiscard]] AnchoredPoint anchored_point(const Eigen::Vector3d& inverse_depth, const Pose& anchor,
                                           const CameraExtrinsics& extrinsics);

// The inverse of it: coordinates (x/z, y/z, 1/z) of a world point in a pose's camera; derivatives
// by the pose, the extrinsics and the point. Not valid (in_front false) behind the camera.
struct InverseDepthOfPoint {
  Eigen::Vector3d inverse_depth = Eigen::Vector3d::Zero();
  bool in_front = false;
  Matrix36d J_pose = Matrix36d::Zero();
  Matrix36d J_extrinsics = Matrix36d::Zero();
  Eigen::Matrix3d J_point = Eigen::Matrix3d::Zero();
};
[[nodiscard]] InverseDepthOfPoint inverse_depth_of_point(const Eigen::Vector3d& p_world,
                                                         const Pose& pose,
                                                         const CameraExtrinsics& extrinsics);

// What wrong intrinsics do to the bearings of a camera without distortion.
[[nodiscard]] BearingByIntrinsics pinhole_by_intrinsics(const Eigen::Vector2d& bearing);

// The same of a camera whose observation, `at` a bearing, says `by_intrinsics`: where the point is
// expected, not where it was seen. In both the residual and its Jacobian, noise would look like a
// longer focal length. What a lens adds to how that changes over so little is left out.
[[nodiscard]] BearingByIntrinsics by_intrinsics_at(const Eigen::Vector2d& expected,
                                                   const Eigen::Vector2d& at,
                                                   const BearingByIntrinsics& by_intrinsics);

// W such that W n has covariance 1 for n of the given one, which must be positive definite.
[[nodiscard]] Eigen::Matrix2d whitening(const Eigen::Matrix2d& covariance);

// Camera pose of an IMU pose.
struct CameraPose {
  Eigen::Matrix3d R_world_cam;
  Eigen::Vector3d p_world_cam;
};
[[nodiscard]] CameraPose camera_pose(const Pose& pose, const CameraExtrinsics& extrinsics);

// Inverse depth of an anchored landmark in the present camera; `relative_sigma`: of its depth,
// given the anchor. Nothing behind the camera.
[[nodiscard]] std::optional<TrackDepth> depth_from(const State& state, const SlamLandmark& landmark,
                                                   double relative_sigma);

}  // namespace covey
