// SPDX-License-Identifier: Apache-2.0
//
// SLAM-SLAM update: an own landmark and a peer's are one point (paper, eq. 14, 15), fused by
// covariance intersection because the two drones' errors may be correlated in ways nobody tracks.
#pragma once

#include "estimator/estimator.h"
#include "estimator/state.h"

namespace covey {

// One landmark after the other, each against the state that the one before left. The landmark's own
// marginal is fused by covariance intersection; the change is carried to the rest of the state by
// regression, x += G (y+ - y), P -= G (S - S+) G^T with G = P H^T inv(S), which stays positive
// definite and leaves alone what is not correlated with the landmark.
[[nodiscard]] PeerReport update_from_peer(State& state, const PeerMatches& matches,
                                          double gate_limit_3dof);

// World position and marginal covariance of a SLAM feature.
[[nodiscard]] LandmarkEstimate landmark_estimate(const State& state, int landmark_index);

}  // namespace covey
