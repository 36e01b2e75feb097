// SPDX-License-Identifier: Apache-2.0
#include "estimator/peer_update.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "estimator/covariance_intersection.h"
#include "estimator/observation_model.h"

namespace covey {
namespace {

// A peer helps where it knows much better. Between equals each fusion only trades one drift for
// another and breaks the smoothness of the own path, so what the trace gains must be at least this
// share.
constexpr double kMinGain = 0.8;

// The landmark's world position now, and P H^T for its Jacobian at the first estimates.
struct WorldLandmark {
  PointEstimate estimate;
  Eigen::MatrixXd PHt;  // dimension x 3
};

WorldLandmark world_landmark(const State& state, int index) {
  const SlamLandmark& landmark = state.landmarks()[static_cast<std::size_t>(index)];
  const int anchor_index = state.find_clone(landmark.anchor_id);
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  const AnchoredPoint first = anchored_point(landmark.first, anchor.first, state.extrinsics());
  const auto P = state.covariance();
  WorldLandmark result;
  result.estimate.mean =
      anchored_point(landmark.inverse_depth, anchor.pose, state.extrinsics()).p_world;
  const int anchor_offset = state.clone_offset(anchor_index);
  const int landmark_offset = state.landmark_offset(index);
  result.PHt = P.middleCols(anchor_offset, 6) * first.J_anchor.transpose() +
               P.middleCols(landmark_offset, 3) * first.J_inverse_depth.transpose();
  if (state.extrinsics_offset() >= 0) {
    result.PHt += P.middleCols(state.extrinsics_offset(), 6) * first.J_extrinsics.transpose();
  }
  Eigen::Matrix3d S = first.J_anchor * result.PHt.middleRows(anchor_offset, 6) +
                      first.J_inverse_depth * result.PHt.middleRows(landmark_offset, 3);
  if (state.extrinsics_offset() >= 0) {
    S += first.J_extrinsics * result.PHt.middleRows(state.extrinsics_offset(), 6);
  }
  result.estimate.covariance = (S + S.transpose()) / 2;
  return result;
}

bool plausible(const LandmarkEstimate& estimate) {
  return estimate.p_world.allFinite() && estimate.covariance.allFinite() &&
         Eigen::LLT<Eigen::Matrix3d>(estimate.covariance).info() == Eigen::Success;
}

}  // namespace

LandmarkEstimate landmark_estimate(const State& state, int landmark_index) {
  const WorldLandmark landmark = world_landmark(state, landmark_index);
  return {state.landmarks()[static_cast<std::size_t>(landmark_index)].track_id,
          landmark.estimate.mean, landmark.estimate.covariance};
}

PeerReport update_from_peer(State& state, const PeerMatches& matches, double gate_limit_3dof) {
  PeerReport report;
  for (const LandmarkMatch& match : matches.matches) {
    const int index = state.find_landmark(match.track_id);
    if (index < 0) {
      ++report.unknown_track;
      continue;
    }
    if (!plausible(match.peer)) {
      ++report.invalid;
      continue;
    }
    const WorldLandmark own = world_landmark(state, index);
    // The gate uses the covariances as they are, not inflated (paper, section III-F).
    const Eigen::Vector3d difference = match.peer.p_world - own.estimate.mean;
    const Eigen::Matrix3d S = own.estimate.covariance + match.peer.covariance;
    if (difference.dot(S.ldlt().solve(difference)) > gate_limit_3dof) {
      ++report.gated;
      continue;
    }
    const IntersectedPoint fused =
        intersect_covariances(own.estimate, {match.peer.p_world, match.peer.covariance});
    const double trace = own.estimate.covariance.trace();
    if (trace - fused.fused.covariance.trace() < kMinGain * trace) {
      ++report.uninformative;
      continue;
    }
    ++report.used;
    const Eigen::MatrixXd G = own.PHt * own.estimate.covariance.inverse();
    state.correct(G * (fused.fused.mean - own.estimate.mean), G,
                  own.estimate.covariance - fused.fused.covariance);
  }
  return report;
}

}  // namespace covey
