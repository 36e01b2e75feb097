// SPDX-License-Identifier: Apache-2.0
#include "estimator/peer_update.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "estimator/covariance_intersection.h"
#include "estimator/ekf_update.h"
#include "estimator/observation_model.h"
#include "estimator/so3.h"

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

// The local columns of its Jacobian, and where they stand in the state: [anchor feature
// (extrinsics)].
Eigen::Matrix3d marginal(const State& state, const WorldLandmark& landmark) {
  Eigen::Matrix<double, 3, 15> J;
  J << landmark.J_anchor, landmark.J_inverse_depth, landmark.J_extrinsics;
  Columns columns;
  columns.add(landmark.anchor_offset, 6);
  columns.add(landmark.landmark_offset, 3);
  if (state.extrinsics_offset() >= 0) columns.add(state.extrinsics_offset(), 6);
  const auto P = state.covariance();
  Eigen::Matrix3d S = Eigen::Matrix3d::Zero();
  for (int i = 0, a = 0; i < columns.count;
       a += columns.ranges[static_cast<std::size_t>(i++)].size) {
    const ColumnRange& rows = columns.ranges[static_cast<std::size_t>(i)];
    for (int k = 0, b = 0; k < columns.count;
         b += columns.ranges[static_cast<std::size_t>(k++)].size) {
      const ColumnRange& cols = columns.ranges[static_cast<std::size_t>(k)];
      S.noalias() += J.middleCols(a, rows.size) *
                     P.block(rows.offset, cols.offset, rows.size, cols.size) *
                     J.middleCols(b, cols.size).transpose();
    }
  }
  return (S + S.transpose()) / 2;
}

bool plausible(const WorldMatch& match) {
  return match.peer.p_world.allFinite() && match.peer.covariance.allFinite() &&
         match.matching_sigma >= 0 && std::isfinite(match.matching_sigma) &&
         Eigen::LLT<Eigen::Matrix3d>(match.peer.covariance).info() == Eigen::Success;
}

struct Pair {
  WorldLandmark own;
  const WorldMatch* match = nullptr;
  double weight = 0;
};

// The pairs that the state knows and that agree; weights by what both know, summing up to one.
std::vector<Pair> agreeing_pairs(const State& state, const std::vector<WorldMatch>& matches,
                                 double gate_limit_3dof, PeerReport& report) {
  std::vector<Pair> pairs;
  double sum = 0;
  for (const WorldMatch& match : matches) {
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

std::vector<WorldMatch> matches_in_world(const KeyframeMatch& match) {
  constexpr double kFarthest = 1e-4;  // 1/m
  const Eigen::Isometry3d& T = match.other.T_world_cam;
  std::vector<WorldMatch> matches;
  for (const LandmarkMatch& landmark : match.matches) {
    if (!(landmark.inverse_depth > kFarthest)) continue;
    const Eigen::Vector3d p_cam = landmark.other_bearing.homogeneous() / landmark.inverse_depth;
    const Eigen::Vector3d from_camera = T.linear() * p_cam;
    Eigen::Matrix<double, 3, 6> J_pose;  // [dp dtheta], in world
    J_pose << Eigen::Matrix3d::Identity(), -skew(from_camera);
    const Eigen::Vector3d by_depth =
        from_camera / landmark.inverse_depth * landmark.inverse_depth_sigma;
    WorldMatch point;
    point.track_id = landmark.track_id;
    point.peer.p_world = T.translation() + from_camera;
    point.peer.covariance =
        J_pose * match.other.covariance * J_pose.transpose() + by_depth * by_depth.transpose();
    point.matching_sigma = match.bearing_sigma * from_camera.norm();
    matches.push_back(point);
  }
  return matches;
}

LandmarkEstimate landmark_estimate(const State& state, int landmark_index) {
  const WorldLandmark landmark = world_landmark(state, landmark_index);
  return {state.landmarks()[static_cast<std::size_t>(landmark_index)].track_id, landmark.p_world,
          marginal(state, landmark)};
}

PeerReport update_from_peer(State& state, const std::vector<WorldMatch>& matches,
                            double gate_limit_3dof) {
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
