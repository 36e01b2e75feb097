// SPDX-License-Identifier: Apache-2.0
#include "estimator/vision_start.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "estimator/median.h"
#include "estimator/observation_model.h"

namespace covey {
namespace {

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

// By how much single depths lower the squared residuals of a track, over what noise leaves for each
// of its rows: 1 where depths do not differ.
constexpr double kBetterFit = 2;

// Of a glimpse: as many as an update may use, but never too few to tell anything.
int max_glimpse_tracks(const EstimatorConfig& config) {
  return std::max(config.max_msckf_features, kMinStartTracks);
}

// A glimpse's row of the common depth needs no room: each of its tracks has two rows less.
int max_tracks(const EstimatorConfig& config) {
  return std::max(config.max_msckf_features + config.max_slam_features, max_glimpse_tracks(config));
}

// Distance of a track from fitting, whatever the state's uncertainty: outliers stay out.
struct Misfit {
  double mean_squared_residual = 0, weight = 1;  // of its rows
  int rows = 0;
};

Misfit misfit_of(const TrackRows& rows, int columns) {
  const int m = rows.count - 3;
  const double squared = rows.of_window.col(columns).segment(3, m).squaredNorm();
  return {squared / m, std::sqrt(std::min(1.0, kStartOutlier * kStartOutlier * m / squared)), m};
}

}  // namespace

VisionStart::VisionStart(const EstimatorConfig& config, int state_capacity)
    : config_(config), rows_(config), stack_(config, max_tracks(config), state_capacity) {}

VisionStart::Quality VisionStart::stack(const State& state,
                                        const std::vector<const Track*>& tracks) {
  const int columns = state.window_size();
  stack_.clear();
  Quality quality;
  std::vector<double> depth_errors, residuals;
  for (const Track* track : tracks) {
    if (!stack_.has_room(*track)) break;
    if (!rows_.linearize(state, *track)) continue;
    depth_errors.push_back(depth_error(state, rows_));
    const Misfit misfit = misfit_of(rows_, columns);
    stack_.add(rows_, columns + 1, misfit.weight);
    residuals.push_back(misfit.mean_squared_residual);
  }
  quality.tracks = static_cast<int>(depth_errors.size());
  if (quality.tracks == 0) return quality;
  quality.median_squared_residual = median(std::move(residuals));
  quality.median_depth_error = median(std::move(depth_errors));
  return quality;
}

StartAttempt VisionStart::start(State& state, State& guess, const std::vector<const Track*>& tracks,
                                bool impatient) {
  using Outcome = StartAttempt::Outcome;
  State current = guess;
  current.forget_first_estimates();
  const int columns = state.window_size();
  for (int i = 0; i < kStartIterations; ++i) {
    if (stack(current, tracks).tracks < kMinStartTracks) return {};
    // Iterated update (Jazwinski 1970, section 8.3): prior and Jacobians at the present iterate.
    stack_.column(columns) += stack_.left(columns) * current.window_minus(state);
    State next = state;
    next.relinearize_time_offset(current);
    if (!stack_.apply(next)) return {};
    next.forget_first_estimates();
    const double change = next.window_minus(current).cwiseAbs().maxCoeff();
    current = next;
    if (change < kStartConverged) break;
  }
  const Quality quality = stack(current, tracks);
  const double error = quality.median_depth_error;
  if (quality.tracks < kMinStartTracks || quality.median_squared_residual > kMaxStartResidual ||
      !(error < (impatient ? kMaxBearingDepthError : config_.max_msckf_depth_error))) {
    return {};
  }
  guess = current;
  current.separate_scale();
  if (!impatient && !(stack(current, tracks).median_depth_error < kMaxStartDepthError)) {
    return {Outcome::kTooSoon, 0};
  }
  state = std::move(current);
  return {Outcome::kMade, quality.tracks};
}

// One row more: of rho = (1 + e) rho_common, e ~ N(0, kRelief^2).
bool VisionStart::linearize_glimpsed(const State& state, const Track& track, double depth,
                                     Point& point) {
  const int anchor_index = choose_anchor(state, track);
  if (anchor_index < 0 || track.observations.size() < 2) return false;
  const Clone& anchor = state.clones()[static_cast<std::size_t>(anchor_index)];
  if (point.in_anchor.isZero()) {
    point.in_anchor << true_bearing(state, *track.find(anchor.id)), 1 / depth;
  }
  const Eigen::Vector3d p_world =
      anchored_point(point.in_anchor, anchor.pose, state.extrinsics()).p_world;
  if (!rows_.fill(state, track, p_world)) return false;
  const int columns = state.window_size();
  const double ratio = point.in_anchor.z() * depth;
  rows_.of_window.col(columns + 1).head(rows_.count).setZero();
  rows_.of_window.row(rows_.count).head(columns).setZero();
  rows_.of_window(rows_.count, columns) = (1 - ratio) / kRelief;
  rows_.of_window(rows_.count, columns + 1) = ratio / kRelief;
  rows_.of_feature.row(rows_.count) << 0, 0, depth / kRelief;
  ++rows_.count;
  project_out_feature(rows_.of_feature.topRows(rows_.count),
                      rows_.of_window.topLeftCorner(rows_.count, columns + 2));
  point.R = rows_.upper_triangle();
  point.rows = rows_.of_window.topLeftCorner(3, columns + 2);
  return true;
}

void VisionStart::Point::move(const Step& moved) {
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

VisionStart::Quality VisionStart::stack_glimpsed(const State& state,
                                                 const std::vector<const Track*>& tracks,
                                                 double depth, std::vector<Point>& points) {
  const int columns = state.window_size();
  Eigen::RowVectorXd far = Eigen::RowVectorXd::Zero(columns + 2);
  far.tail<2>() << std::log(kFarDepth_m / depth) / kDepthSpread, 1 / kDepthSpread;
  stack_.clear();
  stack_.add(far);
  std::vector<double> residuals, rows;
  points.resize(tracks.size());
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (static_cast<int>(residuals.size()) == max_glimpse_tracks(config_)) break;
    if (!linearize_glimpsed(state, *tracks[i], depth, points[i])) {
      points[i] = {};
      continue;
    }
    const Misfit misfit = misfit_of(rows_, columns);
    stack_.add(rows_, columns + 2, misfit.weight);
    residuals.push_back(misfit.mean_squared_residual);
    rows.push_back(misfit.rows);
  }
  Quality quality;
  quality.tracks = static_cast<int>(residuals.size());
  if (quality.tracks == 0) return quality;
  quality.median_squared_residual = median(std::move(residuals));
  quality.median_rows = median(std::move(rows));
  return quality;
}

// A reflection after which the first row alone depends on the common depth; the others are what is
// known whatever that depth is.
VisionStart::DepthRow VisionStart::take_depth_out(int columns) {
  Eigen::VectorXd reflection = stack_.column(columns + 1);
  DepthRow taken;
  taken.of_depth = -std::copysign(reflection.norm(), reflection(0));
  reflection(0) -= taken.of_depth;
  auto rows = stack_.left(columns + 1);
  const Eigen::RowVectorXd share = 2 / reflection.squaredNorm() * reflection.transpose() * rows;
  rows -= reflection * share;
  taken.H = rows.row(0).head(columns);
  taken.r = rows(0, columns);
  rows.row(0).setZero();
  return taken;
}

// Where single depths show, iterations must keep them: with all points put equally far again each
// time they run away, by centimetres while all that is left of the tracks is still within what they
// claim. Where they do not show, they would be fitted to noise: all come out too near, which claims
// to see more of the motion than there is to see, if the iterations settle at all.
std::optional<State> VisionStart::glimpse(const State& state,
                                          const std::vector<const Track*>& tracks) {
  std::optional<Glimpse> far = glimpse(state, tracks, Points::kEquallyFar);
  std::optional<Glimpse> kept = glimpse(state, tracks, Points::kKept);
  if (!far && !kept) return std::nullopt;
  if (!far || (kept && fits_better(kept->quality, far->quality))) return std::move(kept->state);
  const bool shows_in_kept = kept && kept->convincing && !far->convincing;
  return std::move(shows_in_kept ? kept->state : far->state);
}

// An F test of one depth more for each track, of medians.
bool VisionStart::fits_better(const Quality& kept, const Quality& equally_far) {
  const double rows = kept.median_rows;
  const double left = kept.median_squared_residual,
               lowered = equally_far.median_squared_residual - left;
  return rows > 1 && lowered * (rows - 1) > kBetterFit * left;
}

bool VisionStart::shows_relief(const std::vector<Point>& points) {
  std::vector<double> inverse_depths;
  for (const Point& point : points) {
    if (!point.in_anchor.isZero()) inverse_depths.push_back(point.in_anchor.z());
  }
  if (inverse_depths.empty()) return false;
  std::sort(inverse_depths.begin(), inverse_depths.end());
  const std::size_t quarter = inverse_depths.size() / 4;
  const double nearest = inverse_depths[inverse_depths.size() - 1 - quarter];
  return nearest > kVisibleRelief * inverse_depths[quarter];
}

// One iteration: from the prior, about the present iterate, whatever the common depth is.
std::optional<VisionStart::Step> VisionStart::step_glimpse(const State& prior, State& current) {
  const int columns = prior.window_size();
  stack_.column(columns) += stack_.left(columns) * current.window_minus(prior);
  const DepthRow row = take_depth_out(columns);
  State next = prior;
  if (!stack_.apply(next)) return std::nullopt;
  next.forget_first_estimates();
  const double log_depth = (row.r - row.H.dot(next.window_minus(prior))) / row.of_depth;
  Step step{next.window_minus(current), std::clamp(log_depth, -kMaxLogStep, kMaxLogStep)};
  current = std::move(next);
  return step;
}

// As the start, with the common depth beside the state.
std::optional<VisionStart::Glimpse> VisionStart::glimpse(const State& state,
                                                         const std::vector<const Track*>& tracks,
                                                         Points mode) {
  State current = state;
  current.forget_first_estimates();
  std::vector<Point> points;
  double depth = kFarDepth_m;
  bool converged = false;
  const int iterations = mode == Points::kKept ? kGlimpseIterations : kStartIterations;
  for (int i = 0; i < iterations && !converged; ++i) {
    if (mode == Points::kEquallyFar) points.clear();
    if (stack_glimpsed(current, tracks, depth, points).tracks < kMinStartTracks) {
      return std::nullopt;
    }
    const std::optional<Step> step = step_glimpse(state, current);
    if (!step) return std::nullopt;
    for (Point& point : points) point.move(*step);
    depth = std::clamp(depth * std::exp(step->log_depth), config_.min_depth, config_.max_depth);
    converged = step->window.cwiseAbs().maxCoeff() < kStartConverged;
  }
  if (mode == Points::kKept && !converged) return std::nullopt;
  if (mode == Points::kEquallyFar) points.clear();
  const Quality quality = stack_glimpsed(current, tracks, depth, points);
  if (!(quality.median_squared_residual < kMaxGlimpseResidual)) return std::nullopt;
  if (mode == Points::kEquallyFar) {
    const bool fits = converged && quality.median_squared_residual < kGoodGlimpseResidual;
    return Glimpse{std::move(current), quality, fits};
  }
  // What is told, and how sure it is, comes from there as if all were equally far.
  const bool relief = shows_relief(points);
  points.clear();
  (void)stack_glimpsed(current, tracks, depth, points);
  if (!step_glimpse(state, current)) return std::nullopt;
  return Glimpse{std::move(current), quality, relief};
}

}  // namespace covey
