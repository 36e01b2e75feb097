// SPDX-License-Identifier: Apache-2.0
#include "estimator/vision_update.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>

#include "estimator/observation_model.h"

namespace covey {

VisionUpdate::VisionUpdate(const EstimatorConfig& config, int state_capacity)
    : config_(config),
      gate_(config.gate_confidence, 2 * (config.max_clones + 2)),
      rows_(config),
      stack_(config, config.max_msckf_features + config.max_slam_features, state_capacity) {}

VisionUpdate::Outcome VisionUpdate::examine(const State& state, const Track& track,
                                            double max_depth_error) {
  if (!rows_.linearize(state, track) || !(depth_error(state, rows_) <= max_depth_error)) {
    return Outcome::kUntriangulated;
  }
  return passes_gate(state) ? Outcome::kOk : Outcome::kGated;
}

std::optional<LandmarkRows> VisionUpdate::upper_rows(const State& state, const Track& track,
                                                     const Eigen::Vector3d& guess_world) {
  if (!rows_.linearize(state, track) && !rows_.linearize_at(state, track, guess_world)) {
    return std::nullopt;
  }
  const int m = std::min(3, rows_.count);
  const int columns = state.window_size();
  const int window = State::kWindow;
  LandmarkRows rows;
  rows.landmark = rows_.landmark;
  rows.R = rows_.of_feature.topRows(m).triangularView<Eigen::Upper>();
  rows.H = Eigen::MatrixXd::Zero(m, state.dimension());
  rows.H.middleCols(window, columns) = rows_.of_window.topLeftCorner(m, columns);
  rows.r = rows_.of_window.col(columns).head(m);
  rows.noise = Eigen::MatrixXd::Identity(m, m);
  return rows;
}

std::optional<TrackDepth> VisionUpdate::depth_of(const State& state, const Track& track) {
  if (!rows_.linearize(state, track)) return std::nullopt;
  const double relative_sigma = depth_error(state, rows_, DepthUnit::kMetre);
  if (!(relative_sigma < config_.max_msckf_depth_error)) return std::nullopt;
  return depth_from(state, rows_.landmark, relative_sigma);
}

// Chi-square test of the rows that no longer depend on the feature: 2k - 3 degrees of freedom.
bool VisionUpdate::passes_gate(const State& state) const {
  const int columns = state.window_size();
  const int m = rows_.count - 3;
  const auto H = rows_.of_window.block(3, 0, m, columns);
  const auto r = rows_.of_window.col(columns).segment(3, m);
  const int window = State::kWindow;
  const auto P = state.covariance().block(window, window, columns, columns);
  Eigen::MatrixXd S = Eigen::MatrixXd::Identity(m, m);
  const Eigen::MatrixXd HP = H * P;
  S.noalias() += HP * H.transpose();
  return r.dot(S.ldlt().solve(r)) < gate_.limit(m);
}

// The three rows that do depend on the feature make it part of the state (Li and Mourikis, 2012):
// R df + H dx + n = r  gives  df = inv(R) (r - H dx - n).
void VisionUpdate::augment(State& state) const {
  const int columns = state.window_size();
  const int window = State::kWindow;
  const Eigen::Matrix3d R_inverse = rows_.upper_triangle().inverse();
  const Eigen::MatrixXd J = -R_inverse * rows_.of_window.block(0, 0, 3, columns);
  const int dimension = state.dimension();
  const Eigen::MatrixXd cross = J * state.covariance().block(window, 0, columns, dimension);
  const Eigen::Matrix3d own =
      cross.middleCols(window, columns) * J.transpose() + R_inverse * R_inverse.transpose();
  SlamLandmark landmark = rows_.landmark;
  landmark.inverse_depth += R_inverse * rows_.of_window.col(columns).head<3>();
  state.add_landmark(landmark, cross, (own + own.transpose()) / 2);
}

std::vector<std::uint64_t> VisionUpdate::update_tracks(State& state,
                                                       const std::vector<const Track*>& features,
                                                       const std::vector<const Track*>& candidates,
                                                       int free_slots, UpdateReport& report) {
  std::vector<std::uint64_t> used;
  const int columns = state.window_size();
  stack_.clear();
  int fitting = 0;
  for (const Track* track : features) {
    const Outcome outcome = examine(state, *track, config_.max_msckf_depth_error);
    if (outcome == Outcome::kOk) stack_.add(rows_, columns + 1);
    ++(outcome == Outcome::kOk      ? fitting
       : outcome == Outcome::kGated ? report.msckf_gated
                                    : report.msckf_untriangulated);
    if (outcome != Outcome::kUntriangulated) used.push_back(track->id);
  }
  for (const Track* track : candidates) {
    if (free_slots == 0) break;
    if (examine(state, *track, config_.max_slam_depth_error) != Outcome::kOk) continue;
    stack_.add(rows_, columns + 1);
    augment(state);
    used.push_back(track->id);
    ++report.slam_initialized;
    --free_slots;
  }
  if (stack_.apply(state)) {
    report.msckf_used += fitting;
  } else {
    ++report.failed_updates;
  }
  return used;
}

void VisionUpdate::add_slam_features(State& state, const std::vector<const Track*>& tracks,
                                     UpdateReport& report) {
  for (const Track* track : tracks) {
    if (static_cast<int>(state.landmarks().size()) == config_.max_slam_features) return;
    if (!track->seen_now || examine(state, *track, config_.max_slam_depth_error) != Outcome::kOk) {
      continue;
    }
    augment(state);
    ++report.slam_initialized;
  }
}

}  // namespace covey
