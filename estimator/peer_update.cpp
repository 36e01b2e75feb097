// SPDX-License-Identifier: Apache-2.0
#include "estimator/peer_update.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "estimator/covariance_intersection.h"
#include "estimator/observation_model.h"

namespace covey {
namespace {

// A peer helps where it knows much better. Between equals each fusion only trades one drift for
// another and breaks the smoothness of the own path, so what the trace gains must be at least this
// share.
constexpr double kMinGain = 0.5;

// A SLAM feature in the world, with the Jacobian of its position at the first estimates.
struct WorldLandmark {
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();
  Eigen::Matrix<double, 3, 6> J_anchor, J_extrinsics;
  Eigen::Matrix3d J_inverse_depth = Eigen::Matrix3d::Zero();
  int anchor_offset = 0, landmark_offset = 0;
};

WorldLandmark world_landmark(const State& state, int index) {
  const SlamLandmark& landmark = state.landmarks()[static_cast<std::size_t>(index)];
  const int anchor_index = state.find_clone(landmark.anchor_id);
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  const AnchoredPoint first = anchored_point(landmark.first, anchor.first, state.extrinsics());
  return {anchored_point(landmark.inverse_depth, anchor.pose, state.extrinsics()).p_world,
          first.J_anchor,
          first.J_extrinsics,
          first.J_inverse_depth,
          state.clone_offset(anchor_index),
          state.landmark_offset(index)};
}

// H += weight * d(p_world)/d(error state); `H`: 3 x dimension.
void add_jacobian(const State& state, const WorldLandmark& landmark, double weight,
                  Eigen::MatrixXd& H) {
  H.middleCols(landmark.anchor_offset, 6) += weight * landmark.J_anchor;
  H.middleCols(landmark.landmark_offset, 3) += weight * landmark.J_inverse_depth;
  if (state.extrinsics_offset() >= 0) {
    H.middleCols(state.extrinsics_offset(), 6) += weight * landmark.J_extrinsics;
  }
}

Eigen::Matrix3d marginal(const State& state, const WorldLandmark& landmark) {
  const auto P = state.covariance();
  const int a = landmark.anchor_offset, l = landmark.landmark_offset;
  Eigen::MatrixXd J(3, 9), P_local(9, 9);
  J << landmark.J_anchor, landmark.J_inverse_depth;
  P_local << P.block(a, a, 6, 6), P.block(a, l, 6, 3), P.block(l, a, 3, 6), P.block(l, l, 3, 3);
  if (const int e = state.extrinsics_offset(); e >= 0) {
    J.conservativeResize(3, 15);
    J.rightCols<6>() = landmark.J_extrinsics;
    P_local.conservativeResize(15, 15);
    P_local.bottomRightCorner(6, 6) = P.block(e, e, 6, 6);
    P_local.block(0, 9, 6, 6) = P.block(a, e, 6, 6);
    P_local.block(6, 9, 3, 6) = P.block(l, e, 3, 6);
    P_local.block(9, 0, 6, 9) = P_local.block(0, 9, 9, 6).transpose();
  }
  const Eigen::Matrix3d S = J * P_local * J.transpose();
  return (S + S.transpose()) / 2;
}

bool plausible(const LandmarkMatch& match) {
  return match.peer.p_world.allFinite() && match.peer.covariance.allFinite() &&
         match.matching_sigma >= 0 && std::isfinite(match.matching_sigma) &&
         Eigen::LLT<Eigen::Matrix3d>(match.peer.covariance).info() == Eigen::Success;
}

struct Pair {
  WorldLandmark own;
  const LandmarkMatch* match = nullptr;
  double weight = 0;
};

// The pairs that the state knows and that agree; weights by what both know, summing up to one.
std::vector<Pair> agreeing_pairs(const State& state, const PeerMatches& matches,
                                 double gate_limit_3dof, PeerReport& report) {
  std::vector<Pair> pairs;
  double sum = 0;
  for (const LandmarkMatch& match : matches.matches) {
    const int index = state.find_landmark(match.track_id);
    if (index < 0) {
      ++report.unknown_track;
      continue;
    }
    if (!plausible(match)) {
      ++report.invalid;
      continue;
    }
    const WorldLandmark own = world_landmark(state, index);
    // The gate uses the covariances as they are, not inflated (paper, section III-F).
    const Eigen::Vector3d difference = match.peer.p_world - own.p_world;
    Eigen::Matrix3d S = marginal(state, own) + match.peer.covariance;
    S.diagonal().array() += match.matching_sigma * match.matching_sigma;
    if (difference.dot(S.ldlt().solve(difference)) > gate_limit_3dof) {
      ++report.gated;
      continue;
    }
    pairs.push_back({own, &match, 1 / S.trace()});
    sum += pairs.back().weight;
  }
  for (Pair& pair : pairs) pair.weight /= sum;
  return pairs;
}

// The peer's idea of the weighted mean of the landmarks. How its errors hang together nobody says;
// for weights that sum up to one the weighted mean of the covariances is never too small. What
// matching adds is independent from pair to pair.
PointEstimate peer_mean(const std::vector<Pair>& pairs) {
  PointEstimate mean;
  mean.covariance.setZero();
  for (const Pair& pair : pairs) {
    const double matching = pair.weight * pair.match->matching_sigma;
    mean.mean += pair.weight * pair.match->peer.p_world;
    mean.covariance += pair.weight * pair.match->peer.covariance;
    mean.covariance.diagonal().array() += matching * matching;
  }
  return mean;
}

}  // namespace

LandmarkEstimate landmark_estimate(const State& state, int landmark_index) {
  const WorldLandmark landmark = world_landmark(state, landmark_index);
  return {state.landmarks()[static_cast<std::size_t>(landmark_index)].track_id, landmark.p_world,
          marginal(state, landmark)};
}

PeerReport update_from_peer(State& state, const PeerMatches& matches, double gate_limit_3dof) {
  PeerReport report;
  const std::vector<Pair> pairs = agreeing_pairs(state, matches, gate_limit_3dof, report);
  if (pairs.empty()) return report;
  const int count = static_cast<int>(pairs.size());

  PointEstimate own;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(3, state.dimension());
  for (const Pair& pair : pairs) {
    own.mean += pair.weight * pair.own.p_world;
    add_jacobian(state, pair.own, pair.weight, H);
  }
  const Eigen::MatrixXd PHt = state.covariance() * H.transpose();
  own.covariance = H * PHt;
  const PointEstimate peer = peer_mean(pairs);
  const Eigen::Vector3d difference = peer.mean - own.mean;
  const Eigen::Matrix3d S = own.covariance + peer.covariance;
  if (difference.dot(S.ldlt().solve(difference)) > gate_limit_3dof) {
    report.gated += count;
    return report;
  }
  const IntersectedPoint fused = intersect_covariances(own, peer);
  const double trace = own.covariance.trace();
  if (trace - fused.fused.covariance.trace() < kMinGain * trace) {
    report.uninformative += count;
    return report;
  }
  report.used += count;
  const Eigen::MatrixXd G = PHt * own.covariance.inverse();
  state.correct(G * (fused.fused.mean - own.mean), G, own.covariance - fused.fused.covariance);
  return report;
}

}  // namespace covey
