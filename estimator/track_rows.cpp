// SPDX-License-Identifier: Apache-2.0
#include "estimator/track_rows.h"

#include <Eigen/LU>
#include <cmath>

#include "estimator/observation_model.h"

namespace covey {
namespace {

int max_observations(const EstimatorConfig& config) { return config.max_clones + 2; }

int max_columns(const EstimatorConfig& config) {
  constexpr int kMostCalibration = 7 + kIntrinsicsSize;
  constexpr int kResidualAndOneMore = 2;
  return kMostCalibration + 6 * max_observations(config) + kResidualAndOneMore;
}

}  // namespace

TrackRows::TrackRows(const EstimatorConfig& config)
    : of_feature(2 * max_observations(config) + 1, 3),
      of_window(2 * max_observations(config) + 1, max_columns(config)),
      noise_scale_(config.observation_noise_scale),
      depth_limits_{config.min_depth, config.max_depth} {
  views_.reserve(static_cast<std::size_t>(max_observations(config)));
}

int choose_anchor(const State& state, const Track& track) {
  for (auto o = track.observations.rbegin(); o != track.observations.rend(); ++o) {
    const int index = state.find_clone(o->clone_id);
    if (index >= 0 && state.clones()[static_cast<std::size_t>(index)].keyframe) return index;
  }
  return -1;
}

Eigen::Vector2d true_bearing(const State& state, const CloneObservation& observation) {
  return observation.bearing - observation.by_intrinsics * state.intrinsics_error();
}

bool TrackRows::linearize(const State& state, const Track& track) {
  if (track.observations.size() < kMinObservations) return false;
  views_.clear();
  for (const CloneObservation& o : track.observations) {
    const Clone& clone = state.clones()[static_cast<std::size_t>(state.find_clone(o.clone_id))];
    views_.push_back({camera_pose(clone.pose, state.extrinsics()), true_bearing(state, o),
                      o.whitening / noise_scale_});
  }
  const auto point = triangulate(views_, depth_limits_);
  if (!point || point->relative_depth_error > kMaxBearingDepthError) return false;
  return linearize_at(state, track, point->p_world);
}

bool TrackRows::linearize_at(const State& state, const Track& track,
                             const Eigen::Vector3d& p_world) {
  if (!fill(state, track, p_world)) return false;
  project_out_feature(of_feature.topRows(count),
                      of_window.topLeftCorner(count, state.window_size() + 1));
  return true;
}

bool TrackRows::fill(const State& state, const Track& track, const Eigen::Vector3d& p_world) {
  const CameraExtrinsics& extrinsics = state.extrinsics();
  const int anchor_index = choose_anchor(state, track);
  if (anchor_index < 0) return false;
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  const auto in_anchor = inverse_depth_of_point(p_world, anchor.pose, extrinsics);
  if (!in_anchor.in_front) return false;
  landmark = {track.id, anchor.id, in_anchor.inverse_depth, in_anchor.inverse_depth, 0};
  const AnchoredPoint first = anchored_point(in_anchor.inverse_depth, anchor.first, extrinsics);

  const int columns = state.window_size();
  count = 2 * static_cast<int>(track.observations.size());
  of_window.topLeftCorner(count, columns + 1).setZero();
  const int window = State::kWindow;
  int row = 0;
  for (const CloneObservation& o : track.observations) {
    const int index = state.find_clone(o.clone_id);
    const Clone& clone = state.clones()[static_cast<std::size_t>(index)];
    const Eigen::Matrix2d W = o.whitening / noise_scale_;
    const PointObservation now = observe_point(p_world, clone.pose, extrinsics);
    const PointObservation at_first = observe_point(first.p_world, clone.first, extrinsics);
    if (!now.in_front || !at_first.in_front) return false;
    const Matrix23d J_point = W * at_first.J_point;
    auto H = of_window.middleRows(row, 2);
    H.middleCols(state.clone_offset(index) - window, 6) += W * at_first.J_pose;
    H.middleCols(state.clone_offset(anchor_index) - window, 6) += J_point * first.J_anchor;
    if (state.extrinsics_offset() >= 0) {
      H.middleCols(state.extrinsics_offset() - window, 6) +=
          W * at_first.J_extrinsics + J_point * first.J_extrinsics;
    }
    const BearingByIntrinsics by_intrinsics =
        by_intrinsics_at(now.bearing, o.bearing, o.by_intrinsics);
    if (state.intrinsics_offset() >= 0) {
      H.middleCols(state.intrinsics_offset() - window, kIntrinsicsSize) += W * by_intrinsics;
    }
    H.col(columns) = W * (o.bearing - by_intrinsics * state.intrinsics_error() - now.bearing);
    of_feature.middleRows(row, 2) = J_point * first.J_inverse_depth;
    row += 2;
  }
  return true;
}

double depth_error(const State& state, const TrackRows& rows, DepthUnit unit) {
  const int columns = state.window_size();
  const int window = State::kWindow;
  const Eigen::Matrix3d R_inverse = rows.upper_triangle().inverse();
  const double rho = rows.landmark.inverse_depth.z();
  const Eigen::RowVectorXd J = R_inverse.row(2) * rows.of_window.block(0, 0, 3, columns) / rho;
  const auto P = state.covariance();
  double variance = (J * P.block(window, window, columns, columns)).dot(J) +
                    R_inverse.row(2).squaredNorm() / (rho * rho);
  if (unit == DepthUnit::kMetre) {
    const int scale = State::kScale;
    variance += 2 * J.dot(P.row(scale).segment(window, columns)) + P(scale, scale);
  }
  return std::sqrt(variance);
}

RowStack::RowStack(const EstimatorConfig& config, int max_tracks, int state_capacity)
    : rows_(max_tracks * 2 * max_observations(config), max_columns(config)),
      update_(state_capacity, state_capacity) {}

bool RowStack::has_room(const Track& track) const {
  return count_ + 2 * static_cast<int>(track.observations.size()) <= rows_.rows();
}

void RowStack::add(const Eigen::RowVectorXd& row) { rows_.row(count_++).head(row.size()) = row; }

void RowStack::add(const TrackRows& track, int columns, double weight) {
  const int m = track.count - 3;
  rows_.block(count_, 0, m, columns) = weight * track.of_window.block(3, 0, m, columns);
  count_ += m;
}

bool RowStack::apply(State& state) {
  if (count_ == 0) return true;
  const int columns = state.window_size();
  const int rows = compress_rows(left(columns + 1));
  Columns range;
  range.add(State::kWindow, columns);
  update_.begin(state);
  update_.add(state, rows_.topLeftCorner(rows, columns), rows_.col(columns).head(rows), range);
  return update_.apply(state);
}

}  // namespace covey
