// SPDX-License-Identifier: Apache-2.0
//
// SLAM-SLAM update: an own landmark and a peer's are one point (paper, eq. 14, 15), fused by
// covariance intersection because the two drones' errors may be correlated in ways nobody tracks.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "estimator/estimator.h"
#include "estimator/state.h"

namespace covey {

// A landmark in the world, with its marginal covariance.
struct LandmarkEstimate {
  std::uint64_t landmark_id = 0;
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();         // m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // m2
};

// Own track `track_id` and a peer's landmark are the same point of the scene.
struct WorldMatch {
  std::uint64_t track_id = 0;
  LandmarkEstimate peer;      // as the peer sent it
  double matching_sigma = 0;  // m, of each axis: how far the two corners may be apart; independent
                              // from match to match
};

// The peer's landmarks in the world that both drones share. Those at infinity are left out.
[[nodiscard]] std::vector<WorldMatch> matches_in_world(const KeyframeMatch& match);

// The landmarks of one message share the drift of their sender, so they count as one: what is fused
// is their weighted mean, a point y = H x of this drone, with the peer's idea of it. The change is
// carried to the rest of the state by regression, x += G (y+ - y), P -= G (S - S+) G^T with
// G = P H^T inv(S), which stays positive definite and leaves alone what is not correlated with the
// landmarks.
[[nodiscard]] PeerReport update_from_peer(State& state, const std::vector<WorldMatch>& matches,
                                          double gate_limit_3dof);

// World position and marginal covariance of a SLAM feature.
[[nodiscard]] LandmarkEstimate landmark_estimate(const State& state, int landmark_index);

}  // namespace covey
