// SPDX-License-Identifier: Apache-2.0
//
// A track's bearings as rows of a measurement (paper, eq. 9 and 10): linearised about the point
// where its rays meet, which is then projected out. And the rows of many tracks, stacked for one
// update.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "estimator/config.h"
#include "estimator/ekf_update.h"
#include "estimator/state.h"
#include "estimator/track_store.h"
#include "estimator/triangulation.h"

namespace covey {

// Of a track, before it says anything about the motion.
constexpr std::size_t kMinObservations = 3;
// Relative, of the depth: beyond it bearing noise alone hides the depth.
constexpr double kMaxBearingDepthError = 0.5;

// One track's whitened rows: R df + H dx + n = r with f = (x/z, y/z, 1/z) in its anchor's camera.
// Once f is projected out R is upper triangular, and only the first three rows depend on it. Memory
// is kept from track to track.
struct TrackRows {
  explicit TrackRows(const EstimatorConfig& config);

  // About the point where the rays meet, projected out; false when they do not.
  [[nodiscard]] bool linearize(const State& state, const Track& track);
  // About a given point (m), projected out; false when it is behind a camera, or no keyframe of the
  // window has seen the track.
  [[nodiscard]] bool linearize_at(const State& state, const Track& track,
                                  const Eigen::Vector3d& p_world);
  // The same, not yet projected out.
  [[nodiscard]] bool fill(const State& state, const Track& track, const Eigen::Vector3d& p_world);

  [[nodiscard]] Eigen::Matrix3d upper_triangle() const {
    return of_feature.topRows<3>().triangularView<Eigen::Upper>();
  }

  SlamLandmark landmark;  // f, where it is linearised
  int count = 0;
  Eigen::Matrix<double, Eigen::Dynamic, 3> of_feature;  // R
  Eigen::MatrixXd of_window;  // [H, columns as in the state's window | r | room for one more]

 private:
  double noise_scale_;
  DepthLimits depth_limits_;
  std::vector<View> views_;
};

// Index of the youngest keyframe that saw the track: it stays in the window longest. -1: none.
[[nodiscard]] int choose_anchor(const State& state, const Track& track);

// A bearing with the intrinsics as calibrated so far.
[[nodiscard]] Eigen::Vector2d true_bearing(const State& state, const CloneObservation& observation);

// Standard deviation of the inverse depth over its value, from the noise of the bearings and the
// uncertainty of the poses between them. In units of the scale it decides whether the linearisation
// holds: bearings do not depend on the scale.
enum class DepthUnit { kScale, kMetre };
[[nodiscard]] double depth_error(const State& state, const TrackRows& rows,
                                 DepthUnit unit = DepthUnit::kScale);

// Rows of many tracks that no longer depend on their features, and the update they make.
class RowStack {
 public:
  RowStack(const EstimatorConfig& config, int max_tracks, int state_capacity);

  void clear() { count_ = 0; }
  [[nodiscard]] bool has_room(const Track& track) const;
  void add(const Eigen::RowVectorXd& row);
  // The first `columns` of a track's rows, each times `weight`.
  void add(const TrackRows& track, int columns, double weight = 1);

  // The first `columns` of what has been added, and a single one.
  [[nodiscard]] auto left(int columns) { return rows_.topLeftCorner(count_, columns); }
  [[nodiscard]] auto column(int index) { return rows_.col(index).head(count_); }

  // Of [H | r]. False when that is not possible: nothing is changed then.
  [[nodiscard]] bool apply(State& state);

 private:
  Eigen::MatrixXd rows_;
  int count_ = 0;
  EkfUpdate update_;
};

}  // namespace covey
