// SPDX-License-Identifier: Apache-2.0
#include "estimator/vision_update.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/median.h"

namespace covey {
namespace {

constexpr int kGatedUntilDropped = 3;
constexpr double kMaxBearingDepthError = 0.5;  // beyond it bearing noise alone hides the depth

// The start: iterations, when it has converged, and when it is believed.
constexpr int kStartIterations = 8, kGlimpseIterations = 20;
constexpr double kStartConverged = 1e-3;  // m and rad, largest change
constexpr int kMinStartTracks = 20;
constexpr double kMaxStartResidual = 2.0;  // median of tracks' mean squared residuals
// Median, relative to the scale. Started sooner, the parallax of every track, linearised where
// depths are wrong by a tenth, would tell what it does not.
constexpr double kMaxStartDepthError = 0.08;
constexpr double kStartOutlier = 3.0;  // root mean square of a track's residuals, in sigma

// Before the start: how far away things are taken to be at first (too far is safe: it claims to see
// less of the motion than there is to see), how much that differs from place to place (factor e),
// and how much single depths differ from the others.
constexpr double kFarDepth_m = 20.0, kDepthSpread = 1.0, kRelief = 0.5;
constexpr double kMaxLogStep = 1;  // of the common depth, at once
// Median of tracks' mean squared residuals: where they disagree more, it has gone astray; as far as
// noise goes, it has not.
constexpr double kMaxGlimpseResidual = 1.25, kGoodGlimpseResidual = 0.9;
// Between the quartiles of the depths. Noise alone makes 1.3 to 1.5 of it (simulated features).
constexpr double kVisibleRelief = 1.6;

// As many as an update may use, but never too few to tell anything.
int max_glimpse_tracks(const EstimatorConfig& config) {
  return std::max(config.max_msckf_features, kMinStartTracks);
}

// The youngest keyframe that saw the track: it stays in the window longest.
int choose_anchor(const State& state, const Track& track) {
  for (auto o = track.observations.rbegin(); o != track.observations.rend(); ++o) {
    const int index = state.find_clone(o->clone_id);
    if (index >= 0 && state.clones()[static_cast<std::size_t>(index)].keyframe) return index;
  }
  return -1;
}

// With the intrinsics as calibrated so far.
Eigen::Vector2d true_bearing(const State& state, const CloneObservation& observation) {
  return observation.bearing - observation.by_intrinsics * state.intrinsics_error();
}

// By what wrong intrinsics do to the bearing where the point is expected, not where it was seen: in
// both the residual and its Jacobian, noise looks like a longer focal length. What a lens adds to
// how that changes over so little is left out.
template <typename Observation>
BearingByIntrinsics by_intrinsics_at(const Eigen::Vector2d& expected,
                                     const Observation& observation) {
  return observation.by_intrinsics + pinhole_by_intrinsics(expected) -
         pinhole_by_intrinsics(observation.bearing);
}

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

  const BearingByIntrinsics by_intrinsics = by_intrinsics_at(now.bearing, observation);
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

VisionUpdate::VisionUpdate(const EstimatorConfig& config, int state_capacity)
    : config_(config),
      gate_(config.gate_confidence, 2 * (config.max_clones + 2)),
      slam_update_(2 * config.max_slam_features, state_capacity),
      stacked_update_(state_capacity, state_capacity) {
  const Eigen::Index max_observations = config.max_clones + 2;
  constexpr Eigen::Index kMostCalibration = 7 + kIntrinsicsSize;
  const Eigen::Index max_columns = kMostCalibration + 6 * max_observations + 1;
  // The glimpse's row of the common depth needs no room: each of its tracks has two rows less.
  const Eigen::Index max_tracks =
      std::max(config.max_msckf_features + config.max_slam_features, max_glimpse_tracks(config));
  H_feature_.resize(2 * max_observations + 1, 3);
  H_track_.resize(2 * max_observations + 1, max_columns + 1);
  stack_.resize(max_tracks * 2 * max_observations, max_columns + 1);
  views_.reserve(static_cast<std::size_t>(max_observations));
}

void VisionUpdate::update_slam(State& state, const std::vector<TrackObservation>& observations,
                               UpdateReport& report) {
  const int clone_index = static_cast<int>(state.clones().size()) - 1;
  const double noise_scale = config_.observation_noise_scale * config_.slam_noise_scale;
  // Does it fit? That is a matter of this image alone, however long its errors last.
  const double one_sight = 1 / (config_.slam_noise_scale * config_.slam_noise_scale);
  slam_update_.begin(state);
  int fitting = 0;
  for (const TrackObservation& observation : observations) {
    const int landmark = state.find_landmark(observation.track_id);
    if (landmark < 0) continue;
    const SlamRows rows = slam_rows(state, landmark, clone_index, observation,
                                    whitening(observation.covariance) / noise_scale);
    bool gated = true;
    if (rows.valid) {
      slam_update_.add(state, rows.H.leftCols(rows.width), rows.r, rows.columns);
      gated = !(slam_update_.last_distance(one_sight) <= gate_.limit(2));
      if (gated) slam_update_.drop_last();
    }
    state.count_gated(landmark, gated);
    ++(gated ? report.slam_gated : fitting);
  }
  if (slam_update_.apply(state)) {
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

bool VisionUpdate::linearize(const State& state, const Track& track, Linearized& result) {
  const CameraExtrinsics& extrinsics = state.extrinsics();
  if (track.observations.size() < kMinObservations) return false;
  views_.clear();
  for (const CloneObservation& o : track.observations) {
    const Clone& clone = state.clones()[static_cast<std::size_t>(state.find_clone(o.clone_id))];
    views_.push_back({camera_pose(clone.pose, extrinsics), true_bearing(state, o),
                      o.whitening / config_.observation_noise_scale});
  }
  const auto point = triangulate(views_, {config_.min_depth, config_.max_depth});
  if (!point || point->relative_depth_error > kMaxBearingDepthError) return false;
  return linearize_at(state, track, point->p_world, result);
}

bool VisionUpdate::linearize_at(const State& state, const Track& track,
                                const Eigen::Vector3d& p_world, Linearized& result) {
  if (!fill_rows(state, track, p_world, result)) return false;
  project_out_feature(H_feature_.topRows(result.rows),
                      H_track_.topLeftCorner(result.rows, state.window_size() + 1));
  return true;
}

bool VisionUpdate::fill_rows(const State& state, const Track& track, const Eigen::Vector3d& p_world,
                             Linearized& result) {
  const CameraExtrinsics& extrinsics = state.extrinsics();
  const int anchor_index = choose_anchor(state, track);
  if (anchor_index < 0) return false;
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  const auto in_anchor = inverse_depth_of_point(p_world, anchor.pose, extrinsics);
  if (!in_anchor.in_front) return false;
  result.landmark = {track.id, anchor.id, in_anchor.inverse_depth, in_anchor.inverse_depth, 0};
  const AnchoredPoint first = anchored_point(in_anchor.inverse_depth, anchor.first, extrinsics);

  const int columns = state.window_size();
  result.rows = 2 * static_cast<int>(track.observations.size());
  H_track_.topLeftCorner(result.rows, columns + 1).setZero();
  const int window = State::kWindow;
  int row = 0;
  for (const CloneObservation& o : track.observations) {
    const int index = state.find_clone(o.clone_id);
    const Clone& clone = state.clones()[static_cast<std::size_t>(index)];
    const Eigen::Matrix2d W = o.whitening / config_.observation_noise_scale;
    const PointObservation now = observe_point(p_world, clone.pose, extrinsics);
    const PointObservation at_first = observe_point(first.p_world, clone.first, extrinsics);
    if (!now.in_front || !at_first.in_front) return false;
    const Matrix23d J_point = W * at_first.J_point;
    auto H = H_track_.middleRows(row, 2);
    H.middleCols(state.clone_offset(index) - window, 6) += W * at_first.J_pose;
    H.middleCols(state.clone_offset(anchor_index) - window, 6) += J_point * first.J_anchor;
    if (state.extrinsics_offset() >= 0) {
      H.middleCols(state.extrinsics_offset() - window, 6) +=
          W * at_first.J_extrinsics + J_point * first.J_extrinsics;
    }
    const BearingByIntrinsics by_intrinsics = by_intrinsics_at(now.bearing, o);
    if (state.intrinsics_offset() >= 0) {
      H.middleCols(state.intrinsics_offset() - window, kIntrinsicsSize) += W * by_intrinsics;
    }
    H.col(columns) = W * (o.bearing - by_intrinsics * state.intrinsics_error() - now.bearing);
    H_feature_.middleRows(row, 2) = J_point * first.J_inverse_depth;
    row += 2;
  }
  return true;
}

// One row more: of rho = (1 + e) rho_common, e ~ N(0, kRelief^2).
bool VisionUpdate::linearize_glimpsed(const State& state, const Track& track, double depth,
                                      GlimpsedPoint& point, Linearized& result) {
  const int anchor_index = choose_anchor(state, track);
  if (anchor_index < 0 || track.observations.size() < 2) return false;
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  if (point.in_anchor.isZero()) {
    point.in_anchor << true_bearing(state, *track.find(anchor.id)), 1 / depth;
  }
  const Eigen::Vector3d p_world =
      anchored_point(point.in_anchor, anchor.pose, state.extrinsics()).p_world;
  if (!fill_rows(state, track, p_world, result)) return false;
  const int columns = state.window_size();
  const double ratio = point.in_anchor.z() * depth;
  H_track_.col(columns + 1).head(result.rows).setZero();
  H_track_.row(result.rows).head(columns).setZero();
  H_track_(result.rows, columns) = (1 - ratio) / kRelief;
  H_track_(result.rows, columns + 1) = ratio / kRelief;
  H_feature_.row(result.rows) << 0, 0, depth / kRelief;
  ++result.rows;
  project_out_feature(H_feature_.topRows(result.rows),
                      H_track_.topLeftCorner(result.rows, columns + 2));
  point.R = H_feature_.topRows<3>().triangularView<Eigen::Upper>();
  point.rows = H_track_.topLeftCorner(3, columns + 2);
  return true;
}

void VisionUpdate::GlimpsedPoint::move(const GlimpseStep& moved) {
  constexpr double kLeast = 0.3, kMost = 3;  // change of the inverse depth at once
  if (rows.size() == 0) return;
  const Eigen::Index columns = moved.window.size();
  const Eigen::Vector3d step = R.triangularView<Eigen::Upper>().solve(
      rows.col(columns) - rows.leftCols(columns) * moved.window -
      moved.log_depth * rows.col(columns + 1));
  const double rho = in_anchor.z();
  in_anchor += step;
  in_anchor.z() = std::clamp(in_anchor.z(), kLeast * rho, kMost * rho);
}

VisionUpdate::Outcome VisionUpdate::examine(const State& state, const Track& track,
                                            double max_depth_error, Linearized& result) {
  if (!linearize(state, track, result) || !(depth_error(state, result) <= max_depth_error)) {
    return Outcome::kUntriangulated;
  }
  return passes_gate(state, result.rows) ? Outcome::kOk : Outcome::kGated;
}

// Standard deviation of the inverse depth over its value, from the noise of the bearings and the
// uncertainty of the poses between them. Relative to the scale it decides whether the linearisation
// holds: bearings do not depend on the scale.
double VisionUpdate::depth_error(const State& state, const Linearized& feature, Depth depth) const {
  const int columns = state.window_size();
  const int window = State::kWindow;
  const Eigen::Matrix3d R_inverse =
      Eigen::Matrix3d(H_feature_.topRows<3>().triangularView<Eigen::Upper>()).inverse();
  const double rho = feature.landmark.inverse_depth.z();
  const Eigen::RowVectorXd J = R_inverse.row(2) * H_track_.block(0, 0, 3, columns) / rho;
  const auto P = state.covariance();
  double variance = (J * P.block(window, window, columns, columns)).dot(J) +
                    R_inverse.row(2).squaredNorm() / (rho * rho);
  if (depth == Depth::kInMetres) {
    const int scale = State::kScale;
    variance += 2 * J.dot(P.row(scale).segment(window, columns)) + P(scale, scale);
  }
  return std::sqrt(variance);
}

std::optional<LandmarkRows> VisionUpdate::upper_rows(const State& state, const Track& track,
                                                     const Eigen::Vector3d& guess_world) {
  Linearized feature;
  if (!linearize(state, track, feature) && !linearize_at(state, track, guess_world, feature)) {
    return std::nullopt;
  }
  const int m = std::min(3, feature.rows);
  const int columns = state.window_size();
  const int window = State::kWindow;
  LandmarkRows rows;
  rows.landmark = feature.landmark;
  rows.R = H_feature_.topRows(m).triangularView<Eigen::Upper>();
  rows.H = Eigen::MatrixXd::Zero(m, state.dimension());
  rows.H.middleCols(window, columns) = H_track_.topLeftCorner(m, columns);
  rows.r = H_track_.col(columns).head(m);
  rows.noise = Eigen::MatrixXd::Identity(m, m);
  return rows;
}

std::optional<TrackDepth> VisionUpdate::depth_of(const State& state, const Track& track) {
  Linearized feature;
  if (!linearize(state, track, feature)) return std::nullopt;
  const double relative_sigma = depth_error(state, feature, Depth::kInMetres);
  if (!(relative_sigma < config_.max_msckf_depth_error)) return std::nullopt;
  return depth_from(state, feature.landmark, relative_sigma);
}

// Chi-square test of the rows that no longer depend on the feature: 2k - 3 degrees of freedom.
bool VisionUpdate::passes_gate(const State& state, int rows) const {
  const int columns = state.window_size();
  const int m = rows - 3;
  const auto H = H_track_.block(3, 0, m, columns);
  const auto r = H_track_.col(columns).segment(3, m);
  const int window = State::kWindow;
  const auto P = state.covariance().block(window, window, columns, columns);
  Eigen::MatrixXd S = Eigen::MatrixXd::Identity(m, m);
  const Eigen::MatrixXd HP = H * P;
  S.noalias() += HP * H.transpose();
  return r.dot(S.ldlt().solve(r)) < gate_.limit(m);
}

void VisionUpdate::stack_rows(int rows, int columns) {
  const int m = rows - 3;
  stack_.block(stack_rows_, 0, m, columns + 1) = H_track_.block(3, 0, m, columns + 1);
  stack_rows_ += m;
}

// The three rows that do depend on the feature make it part of the state (Li and Mourikis, 2012):
// R df + H dx + n = r  gives  df = inv(R) (r - H dx - n).
void VisionUpdate::augment(State& state, const Linearized& feature) {
  const int columns = state.window_size();
  const int window = State::kWindow;
  const Eigen::Matrix3d R = H_feature_.topRows<3>().triangularView<Eigen::Upper>();
  const Eigen::Matrix3d R_inverse = R.inverse();
  const Eigen::MatrixXd J = -R_inverse * H_track_.block(0, 0, 3, columns);
  const int dimension = state.dimension();
  const Eigen::MatrixXd cross = J * state.covariance().block(window, 0, columns, dimension);
  const Eigen::Matrix3d own =
      cross.middleCols(window, columns) * J.transpose() + R_inverse * R_inverse.transpose();
  SlamLandmark landmark = feature.landmark;
  landmark.inverse_depth += R_inverse * H_track_.col(columns).head<3>();
  state.add_landmark(landmark, cross, (own + own.transpose()) / 2);
}

std::vector<std::uint64_t> VisionUpdate::update_tracks(State& state,
                                                       const std::vector<const Track*>& features,
                                                       const std::vector<const Track*>& candidates,
                                                       int free_slots, UpdateReport& report) {
  std::vector<std::uint64_t> used;
  const int columns = state.window_size();
  stack_rows_ = 0;
  Linearized feature;
  int fitting = 0;
  for (const Track* track : features) {
    const Outcome outcome = examine(state, *track, config_.max_msckf_depth_error, feature);
    if (outcome == Outcome::kOk) stack_rows(feature.rows, columns);
    ++(outcome == Outcome::kOk      ? fitting
       : outcome == Outcome::kGated ? report.msckf_gated
                                    : report.msckf_untriangulated);
    if (outcome != Outcome::kUntriangulated) used.push_back(track->id);
  }
  for (const Track* track : candidates) {
    if (free_slots == 0) break;
    if (examine(state, *track, config_.max_slam_depth_error, feature) != Outcome::kOk) continue;
    stack_rows(feature.rows, columns);
    augment(state, feature);
    used.push_back(track->id);
    ++report.slam_initialized;
    --free_slots;
  }
  if (apply_stack(state)) {
    report.msckf_used += fitting;
  } else {
    ++report.failed_updates;
  }
  return used;
}

VisionUpdate::StartQuality VisionUpdate::stack_for_start(const State& state,
                                                         const std::vector<const Track*>& tracks) {
  const int columns = state.window_size();
  stack_rows_ = 0;
  StartQuality quality;
  std::vector<double> depth_errors, residuals;
  Linearized feature;
  for (const Track* track : tracks) {
    if (stack_rows_ + 2 * static_cast<int>(track->observations.size()) > stack_.rows()) break;
    if (!linearize(state, *track, feature)) continue;
    const int m = feature.rows - 3;
    // Distance of this track from fitting, whatever the state's uncertainty: outliers stay out.
    const double squared = H_track_.col(columns).segment(3, m).squaredNorm();
    depth_errors.push_back(depth_error(state, feature));
    const double weight = std::min(1.0, kStartOutlier * kStartOutlier * m / squared);
    H_track_.block(3, 0, m, columns + 1) *= std::sqrt(weight);
    residuals.push_back(squared / m);
    stack_rows(feature.rows, columns);
  }
  quality.tracks = static_cast<int>(depth_errors.size());
  if (quality.tracks == 0) return quality;
  quality.median_squared_residual = median(std::move(residuals));
  quality.median_depth_error = median(std::move(depth_errors));
  return quality;
}

VisionUpdate::Start VisionUpdate::start(State& state, State& guess,
                                        const std::vector<const Track*>& tracks, bool impatient,
                                        UpdateReport& report) {
  State current = guess;
  current.forget_first_estimates();
  const int columns = state.window_size();
  for (int i = 0; i < kStartIterations; ++i) {
    if (stack_for_start(current, tracks).tracks < kMinStartTracks) return Start::kNone;
    // Iterated update (Jazwinski 1970, section 8.3): prior and Jacobians at the present iterate.
    auto H = stack_.topLeftCorner(stack_rows_, columns);
    stack_.col(columns).head(stack_rows_) += H * current.window_minus(state);
    State next = state;
    next.relinearize_time_offset(current);
    if (!apply_stack(next)) return Start::kNone;
    next.forget_first_estimates();
    const double change = next.window_minus(current).cwiseAbs().maxCoeff();
    current = next;
    if (change < kStartConverged) break;
  }
  const StartQuality quality = stack_for_start(current, tracks);
  const double error = quality.median_depth_error;
  if (quality.tracks < kMinStartTracks || quality.median_squared_residual > kMaxStartResidual ||
      !(error < (impatient ? kMaxBearingDepthError : config_.max_msckf_depth_error))) {
    return Start::kNone;
  }
  guess = current;
  current.separate_scale();
  if (!impatient && !(stack_for_start(current, tracks).median_depth_error < kMaxStartDepthError)) {
    return Start::kTooSoon;
  }
  state = std::move(current);
  report.msckf_used += quality.tracks;
  augment_at_start(state, tracks, report);
  return Start::kMade;
}

// The tracks' own rows are still unused: they make the tracks that go on SLAM features, so that
// what has been learnt about their depth is kept.
void VisionUpdate::augment_at_start(State& state, const std::vector<const Track*>& tracks,
                                    UpdateReport& report) {
  Linearized feature;
  for (const Track* track : tracks) {
    if (static_cast<int>(state.landmarks().size()) == config_.max_slam_features) return;
    if (!track->seen_now ||
        examine(state, *track, config_.max_slam_depth_error, feature) != Outcome::kOk) {
      continue;
    }
    augment(state, feature);
    ++report.slam_initialized;
  }
}

VisionUpdate::StartQuality VisionUpdate::stack_for_glimpse(const State& state,
                                                           const std::vector<const Track*>& tracks,
                                                           double depth,
                                                           std::vector<GlimpsedPoint>& points) {
  const int columns = state.window_size();
  stack_.row(0).head(columns + 2).setZero();
  stack_(0, columns) = std::log(kFarDepth_m / depth) / kDepthSpread;
  stack_(0, columns + 1) = 1 / kDepthSpread;
  stack_rows_ = 1;
  StartQuality quality;
  std::vector<double> residuals;
  Linearized feature;
  points.resize(tracks.size());
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (static_cast<int>(residuals.size()) == max_glimpse_tracks(config_)) break;
    if (!linearize_glimpsed(state, *tracks[i], depth, points[i], feature)) {
      points[i] = {};
      continue;
    }
    const int m = feature.rows - 3;
    const double squared = H_track_.col(columns).segment(3, m).squaredNorm();
    const double weight = std::min(1.0, kStartOutlier * kStartOutlier * m / squared);
    stack_.block(stack_rows_, 0, m, columns + 2) =
        std::sqrt(weight) * H_track_.block(3, 0, m, columns + 2);
    stack_rows_ += m;
    residuals.push_back(squared / m);
  }
  quality.tracks = static_cast<int>(residuals.size());
  if (quality.tracks > 0) quality.median_squared_residual = median(std::move(residuals));
  return quality;
}

// A reflection after which the first row alone depends on the common depth; the others are what is
// known whatever that depth is.
VisionUpdate::DepthRow VisionUpdate::take_depth_out(int columns) {
  Eigen::VectorXd reflection = stack_.col(columns + 1).head(stack_rows_);
  DepthRow taken;
  taken.of_depth = -std::copysign(reflection.norm(), reflection(0));
  reflection(0) -= taken.of_depth;
  auto rows = stack_.topLeftCorner(stack_rows_, columns + 1);
  const Eigen::RowVectorXd share = 2 / reflection.squaredNorm() * reflection.transpose() * rows;
  rows -= reflection * share;
  taken.H = rows.row(0).head(columns);
  taken.r = rows(0, columns);
  rows.row(0).setZero();
  return taken;
}

// Where single depths show, iterations must keep them: with all points put equally far again each
// time they run away. Where they do not, they would be fitted to noise: all come out too near,
// which claims to see more of the motion than there is to see, if the iterations settle at all.
std::optional<State> VisionUpdate::glimpse(const State& state,
                                           const std::vector<const Track*>& tracks) {
  std::optional<Glimpse> far = glimpse(state, tracks, Points::kEquallyFar);
  if (far && far->convincing) return std::move(far->state);
  std::optional<Glimpse> kept = glimpse(state, tracks, Points::kKept);
  if (kept && (kept->convincing || !far)) return std::move(kept->state);
  if (!far) return std::nullopt;
  return std::move(far->state);
}

bool VisionUpdate::shows_relief(const std::vector<GlimpsedPoint>& points) {
  std::vector<double> inverse_depths;
  for (const GlimpsedPoint& point : points) {
    if (!point.in_anchor.isZero()) inverse_depths.push_back(point.in_anchor.z());
  }
  if (inverse_depths.empty()) return false;
  std::sort(inverse_depths.begin(), inverse_depths.end());
  const std::size_t quarter = inverse_depths.size() / 4;
  const double nearest = inverse_depths[inverse_depths.size() - 1 - quarter];
  return nearest > kVisibleRelief * inverse_depths[quarter];
}

// One iteration: from the prior, about the present iterate, whatever the common depth is.
std::optional<VisionUpdate::GlimpseStep> VisionUpdate::step_glimpse(const State& prior,
                                                                    State& current) {
  const int columns = prior.window_size();
  auto H = stack_.topLeftCorner(stack_rows_, columns);
  stack_.col(columns).head(stack_rows_) += H * current.window_minus(prior);
  const DepthRow row = take_depth_out(columns);
  State next = prior;
  if (!apply_stack(next)) return std::nullopt;
  next.forget_first_estimates();
  const double log_depth = (row.r - row.H.dot(next.window_minus(prior))) / row.of_depth;
  GlimpseStep step{next.window_minus(current), std::clamp(log_depth, -kMaxLogStep, kMaxLogStep)};
  current = std::move(next);
  return step;
}

// As the start, with the common depth beside the state.
std::optional<VisionUpdate::Glimpse> VisionUpdate::glimpse(const State& state,
                                                           const std::vector<const Track*>& tracks,
                                                           Points mode) {
  State current = state;
  current.forget_first_estimates();
  std::vector<GlimpsedPoint> points;
  double depth = kFarDepth_m;
  bool converged = false;
  const int iterations = mode == Points::kKept ? kGlimpseIterations : kStartIterations;
  for (int i = 0; i < iterations && !converged; ++i) {
    if (mode == Points::kEquallyFar) points.clear();
    if (stack_for_glimpse(current, tracks, depth, points).tracks < kMinStartTracks) {
      return std::nullopt;
    }
    const std::optional<GlimpseStep> step = step_glimpse(state, current);
    if (!step) return std::nullopt;
    for (GlimpsedPoint& point : points) point.move(*step);
    depth = std::clamp(depth * std::exp(step->log_depth), config_.min_depth, config_.max_depth);
    converged = step->window.cwiseAbs().maxCoeff() < kStartConverged;
  }
  if (mode == Points::kKept && !converged) return std::nullopt;
  if (mode == Points::kEquallyFar) points.clear();
  const StartQuality quality = stack_for_glimpse(current, tracks, depth, points);
  if (!(quality.median_squared_residual < kMaxGlimpseResidual)) return std::nullopt;
  if (mode == Points::kEquallyFar) {
    const bool fits = converged && quality.median_squared_residual < kGoodGlimpseResidual;
    return Glimpse{std::move(current), fits};
  }
  // What is told, and how sure it is, comes from there as if all were equally far.
  const bool relief = shows_relief(points);
  points.clear();
  (void)stack_for_glimpse(current, tracks, depth, points);
  if (!step_glimpse(state, current)) return std::nullopt;
  return Glimpse{std::move(current), relief};
}

bool VisionUpdate::apply_stack(State& state) {
  if (stack_rows_ == 0) return true;
  const int columns = state.window_size();
  const int rows = compress_rows(stack_.topLeftCorner(stack_rows_, columns + 1));
  Columns range;
  range.add(State::kWindow, columns);
  stacked_update_.begin(state);
  stacked_update_.add(state, stack_.topLeftCorner(rows, columns), stack_.col(columns).head(rows),
                      range);
  return stacked_update_.apply(state);
}

void VisionUpdate::reanchor(State& state, int leaving_clone, UpdateReport& report) const {
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
    ++report.slam_reanchored;
  }
}

}  // namespace covey
