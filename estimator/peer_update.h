// SPDX-License-Identifier: Apache-2.0
//
// Collaborative update: landmarks of a peer's keyframe are points that this drone knows as well, as
// SLAM features (paper, eq. 14, 15) or from the bearings in its window (paper, eq. 9..13).
//
// For two drones the paper's projected residual is p^0 - p^1, each drone's idea of the landmark
// (upper rows multiplied by the inverse of their landmark Jacobian). The landmarks of one message
// share the pose error of their sender, so they are not fused one by one: own knowledge of all of
// them is turned into where the peer's keyframe stands in the own world, y = Y dx + n, and that is
// fused with where the peer says it stands by covariance intersection. Only position and yaw are:
// tilt does not drift, gravity shows it to either drone. Splitting off the noise, which does not
// have to be divided by the weight, made the filter no more accurate and less honest.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "estimator/estimator.h"
#include "estimator/state.h"
#include "estimator/vision_update.h"

namespace covey {

struct SharedLandmark {
  LandmarkRows own;
  // In the camera of the peer's keyframe, with what that pose's errors do not explain: the depth's
  // error, and how far the two drones' corners may be apart. Independent from landmark to landmark.
  Eigen::Vector3d p_other = Eigen::Vector3d::Zero();         // m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // m2
};

struct SharedKeyframe {
  KeyframePose other;  // as the peer says
  // As the own landmarks say, roughly.
  Eigen::Isometry3d T_world_other = Eigen::Isometry3d::Identity();
  std::vector<SharedLandmark> landmarks;
};

// Shares of good landmarks, and of good keyframes, that pass; quantiles of chi-square for 2 and 3
// and for 4 degrees of freedom.
struct PeerGate {
  explicit PeerGate(double confidence);
  double landmark_2dof, landmark_3dof, keyframe_4dof;
};

// Where the peer's keyframe stands, out of own state and bearings alone.
struct Sighting {
  Eigen::Isometry3d T_world_other = Eigen::Isometry3d::Identity();
  Eigen::MatrixXd
      Y;  // d[dp dtheta]/d(error state), both in world: R = Exp(dtheta) R^; 6 x dimension
  Matrix6d noise = Matrix6d::Identity();  // from bearings and the peer's depths
};

// A point of the peer's camera. Nothing when it is too far away to tell.
[[nodiscard]] std::optional<SharedLandmark> landmark_of(const LandmarkMatch& match);
// Own rows of a SLAM feature.
[[nodiscard]] LandmarkRows rows_of(const State& state, int landmark_index);

// Least squares from `keyframe.T_world_other`. Nothing when the landmarks do not fix the pose.
[[nodiscard]] std::optional<Sighting> sight(const State& state, const SharedKeyframe& keyframe);

// `state`: all in metres (State::merge_scale), as a peer speaks. Two messages in a row may be of
// different peers, even of the same landmarks: each is fused with the state that the one before has
// left. Landmarks that do not fit the others are gated, the keyframe when it disagrees with the
// state; both on covariances as they are, not inflated (paper, section III-F). The change of y is
// carried to the state by regression, x += G (y+ - y), P -= G (S - S+) G^T with G = P Y^T inv(S),
// which stays positive definite and leaves alone what is not correlated with y.
[[nodiscard]] PeerReport update_from_peer(State& state, SharedKeyframe keyframe,
                                          const PeerGate& gate);

}  // namespace covey
