// SPDX-License-Identifier: Apache-2.0
#include "estimator/slam_update.h"

#include <cstddef>

#include "estimator/observation_model.h"

namespace covey {
namespace {

constexpr int kGatedUntilDropped = 3;

// Rows of one SLAM feature seen in one clone: Jacobian over [calibration | anchor | clone |
// feature].
struct SlamRows {
  Eigen::Matrix<double, 2, 27> H = Eigen::Matrix<double, 2, 27>::Zero();
  Eigen::Vector2d r = Eigen::Vector2d::Zero();
  Columns columns;
  int width = 0;
  bool valid = false;
};

void append(SlamRows& rows, const Eigen::Ref<const Eigen::MatrixXd>& J, int offset) {
  rows.H.block(0, rows.width, 2, J.cols()) = J;
  rows.columns.add(offset, static_cast<int>(J.cols()));
  rows.width += static_cast<int>(J.cols());
}

SlamRows slam_rows(const State& state, int landmark_index, int clone_index,
                   const TrackObservation& observation, const Eigen::Matrix2d& W) {
  SlamRows rows;
  const SlamLandmark& landmark = state.landmarks()[static_cast<std::size_t>(landmark_index)];
  const int anchor_index = state.find_clone(landmark.anchor_id);
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  const Clone& clone = state.clones()[static_cast<std::size_t>(clone_index)];
  const CameraExtrinsics& extrinsics = state.extrinsics();
  if (landmark.inverse_depth.z() <= 0) return rows;
  const Eigen::Vector3d p_now =
      anchored_point(landmark.inverse_depth, anchor.pose, extrinsics).p_world;
  const PointObservation now = observe_point(p_now, clone.pose, extrinsics);
  const AnchoredPoint point = anchored_point(landmark.first, anchor.first, extrinsics);
  const PointObservation first = observe_point(point.p_world, clone.first, extrinsics);
  if (!now.in_front || !first.in_front) return rows;

  const BearingByIntrinsics by_intrinsics =
      by_intrinsics_at(now.bearing, observation.bearing, observation.by_intrinsics);
  rows.r = W * (observation.bearing - by_intrinsics * state.intrinsics_error() - now.bearing);
  const Matrix23d J_point = W * first.J_point;
  if (state.extrinsics_offset() >= 0) {
    append(rows, W * first.J_extrinsics + J_point * point.J_extrinsics, state.extrinsics_offset());
  }
  if (state.intrinsics_offset() >= 0) {
    append(rows, W * by_intrinsics, state.intrinsics_offset());
  }
  if (anchor_index != clone_index) {
    append(rows, J_point * point.J_anchor, state.clone_offset(anchor_index));
    append(rows, W * first.J_pose, state.clone_offset(clone_index));
  }
  append(rows, J_point * point.J_inverse_depth, state.landmark_offset(landmark_index));
  rows.valid = true;
  return rows;
}

}  // namespace

SlamUpdate::SlamUpdate(const EstimatorConfig& config, int state_capacity)
    : config_(config),
      gate_(config.gate_confidence, 2),
      update_(2 * config.max_slam_features, state_capacity) {}

void SlamUpdate::update(State& state, const std::vector<TrackObservation>& observations,
                        UpdateReport& report) {
  const int clone_index = static_cast<int>(state.clones().size()) - 1;
  const double noise_scale = config_.observation_noise_scale * config_.slam_noise_scale;
  // Does it fit? That is a matter of this image alone, however long its errors last.
  const double one_sight = 1 / (config_.slam_noise_scale * config_.slam_noise_scale);
  update_.begin(state);
  int fitting = 0;
  for (const TrackObservation& observation : observations) {
    const int landmark = state.find_landmark(observation.track_id);
    if (landmark < 0) continue;
    const SlamRows rows = slam_rows(state, landmark, clone_index, observation,
                                    whitening(observation.covariance) / noise_scale);
    bool gated = true;
    if (rows.valid) {
      update_.add(state, rows.H.leftCols(rows.width), rows.r, rows.columns);
      gated = !(update_.last_distance(one_sight) <= gate_.limit(2));
      if (gated) update_.drop_last();
    }
    state.count_gated(landmark, gated);
    ++(gated ? report.slam_gated : fitting);
  }
  if (update_.apply(state)) {
    report.slam_used += fitting;
  } else {
    ++report.failed_updates;
  }
  for (int i = static_cast<int>(state.landmarks().size()) - 1; i >= 0; --i) {
    const SlamLandmark& landmark = state.landmarks()[static_cast<std::size_t>(i)];
    if (landmark.gated_in_a_row < kGatedUntilDropped && landmark.inverse_depth.z() > 0) continue;
    state.remove_landmark(i);
  }
}

void reanchor(State& state, int leaving_clone) {
  const auto& clones = state.clones();
  const std::uint64_t leaving_id = clones[static_cast<std::size_t>(leaving_clone)].id;
  int target = -1;
  for (int i = static_cast<int>(clones.size()) - 1; i >= 0 && target < 0; --i) {
    if (i != leaving_clone && clones[static_cast<std::size_t>(i)].keyframe) target = i;
  }
  const CameraExtrinsics& extrinsics = state.extrinsics();
  for (int i = static_cast<int>(state.landmarks().size()) - 1; i >= 0; --i) {
    const SlamLandmark& landmark = state.landmarks()[static_cast<std::size_t>(i)];
    if (landmark.anchor_id != leaving_id) continue;
    const Clone& from = clones[static_cast<std::size_t>(leaving_clone)];
    const AnchoredPoint now = anchored_point(landmark.inverse_depth, from.pose, extrinsics);
    const AnchoredPoint first = anchored_point(landmark.first, from.first, extrinsics);
    InverseDepthOfPoint moved_now, moved_first;
    if (target >= 0) {
      const Clone& to = clones[static_cast<std::size_t>(target)];
      moved_now = inverse_depth_of_point(now.p_world, to.pose, extrinsics);
      moved_first = inverse_depth_of_point(first.p_world, to.first, extrinsics);
    }
    if (!moved_now.in_front || !moved_first.in_front) {
      state.remove_landmark(i);
      continue;
    }
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(3, state.dimension());
    J.middleCols(state.landmark_offset(i), 3) = moved_first.J_point * first.J_inverse_depth;
    J.middleCols(state.clone_offset(leaving_clone), 6) = moved_first.J_point * first.J_anchor;
    J.middleCols(state.clone_offset(target), 6) += moved_first.J_pose;
    if (state.extrinsics_offset() >= 0) {
      J.middleCols(state.extrinsics_offset(), 6) =
          moved_first.J_extrinsics + moved_first.J_point * first.J_extrinsics;
    }
    SlamLandmark moved = landmark;
    moved.anchor_id = clones[static_cast<std::size_t>(target)].id;
    moved.inverse_depth = moved_now.inverse_depth;
    moved.first = moved_first.inverse_depth;
    state.reanchor_landmark(i, moved, J);
  }
}

}  // namespace covey
