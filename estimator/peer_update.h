// SPDX-License-Identifier: Apache-2.0
//
// SLAM-SLAM update: an own landmark and a peer's are one point (paper, eq. 14, 15), fused by
// covariance intersection because the two drones' errors may be correlated in ways nobody tracks.
#pragma once

#include "estimator/estimator.h"
#include "estimator/state.h"

namespace covey {

// The landmarks of one message share the drift of their sender, so they count as one: what is fused
// is their weighted mean, a point y = H x of this drone, with the peer's idea of it. The change is
// carried to the rest of the state by regression, x += G (y+ - y), P -= G (S - S+) G^T with
// G = P H^T inv(S), which stays positive definite and leaves alone what is not correlated with the
// landmarks.
[[nodiscard]] PeerReport update_from_peer(State& state, const PeerMatches& matches,
                                          double gate_limit_3dof);

// World position and marginal covariance of a SLAM feature.
[[nodiscard]] LandmarkEstimate landmark_estimate(const State& state, int landmark_index);

}  // namespace covey
