// SPDX-License-Identifier: Apache-2.0
//
// The first visual update, and what tracks tell before it is possible. Neither depth nor scale is
// known then, so that one linearisation would be wrong for good.
#pragma once

#include <optional>
#include <vector>

#include "estimator/config.h"
#include "estimator/state.h"
#include "estimator/track_rows.h"
#include "estimator/track_store.h"

namespace covey {

struct StartAttempt {
  enum class Outcome {
    kNone,     // the tracks do not agree, or say nothing of depths
    kTooSoon,  // they agree, but depths are not known well enough to be linearised for good
    kMade,
  };
  Outcome outcome = Outcome::kNone;
  int tracks = 0;  // that were used
};

class VisionStart {
 public:
  VisionStart(const EstimatorConfig& config, int state_capacity);

  // All tracks and all clones at once, iterated (Gauss-Newton on prior and bearings). `guess`:
  // where to begin, of the same window; what has been found unless kNone. Commits it only when
  // depths have become known, or it is `impatient`.
  [[nodiscard]] StartAttempt start(State& state, State& guess,
                                   const std::vector<const Track*>& tracks, bool impatient);

  // Before that: the state as the tracks have it if what is in sight lies about equally far away,
  // however far that is. Hovering shows no depth, but turning, and that it hovers. Not to be kept:
  // the same bearings are used again at the start. Nothing if the tracks do not agree.
  [[nodiscard]] std::optional<State> glimpse(const State& state,
                                             const std::vector<const Track*>& tracks);

 private:
  // Medians over the tracks that were stacked: mean squared whitened residual, its rows, depth
  // error.
  struct Quality {
    int tracks = 0;
    double median_squared_residual = 0, median_rows = 0, median_depth_error = 0;
  };
  [[nodiscard]] Quality stack(const State& state, const std::vector<const Track*>& tracks);

  // By what one iteration of a glimpse moves the window and the logarithm of the common depth.
  struct Step {
    Eigen::VectorXd window;
    double log_depth = 0;
  };
  // A track's point, and what says how it moves with the window and the common depth:
  // R df + H dx + h d(log depth) = r.
  struct Point {
    // x/z, y/z, 1/z in the anchor's camera; zero: not known yet.
    Eigen::Vector3d in_anchor = Eigen::Vector3d::Zero();
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    Eigen::Matrix<double, 3, Eigen::Dynamic> rows;  // [H | r | h]
    void move(const Step& moved);
  };
  // of_depth * d(log depth) + H dx = r
  struct DepthRow {
    double of_depth = 0, r = 0;
    Eigen::RowVectorXd H;
  };
  enum class Points { kKept, kEquallyFar };  // from one iteration to the next
  struct Glimpse {
    State state;
    Quality quality;
    // Of points that are kept: some are nearer than others. Equally far: it fits beyond doubt.
    bool convincing = false;
  };
  [[nodiscard]] static bool fits_better(const Quality& kept, const Quality& equally_far);
  [[nodiscard]] std::optional<Glimpse> glimpse(const State& state,
                                               const std::vector<const Track*>& tracks,
                                               Points mode);
  [[nodiscard]] static bool shows_relief(const std::vector<Point>& points);
  [[nodiscard]] bool linearize_glimpsed(const State& state, const Track& track, double depth,
                                        Point& point);
  [[nodiscard]] Quality stack_glimpsed(const State& state, const std::vector<const Track*>& tracks,
                                       double depth, std::vector<Point>& points);
  [[nodiscard]] std::optional<Step> step_glimpse(const State& prior, State& current);
  [[nodiscard]] DepthRow take_depth_out(int columns);

  EstimatorConfig config_;
  TrackRows rows_;
  RowStack stack_;
};

}  // namespace covey
