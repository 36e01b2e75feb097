// SPDX-License-Identifier: Apache-2.0
//
// What the camera tells the filter: SLAM features seen in the present image, MSCKF features whose
// track ended or whose oldest clone is about to leave, and tracks that become SLAM features.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "estimator/chi_square.h"
#include "estimator/ekf_update.h"
#include "estimator/estimator.h"
#include "estimator/state.h"
#include "estimator/track_store.h"
#include "estimator/triangulation.h"

namespace covey {

// Of a track, before it says anything about the motion.
constexpr std::size_t kMinObservations = 3;

// What this drone knows of a landmark f = (x/z, y/z, 1/z) in its anchor's camera:
//   r = H dx + R df + n
// Of a track these are the upper rows of its bearings (paper, eq. 10), which its null-space rows
// leave over; of a SLAM feature, 0 = df - dx_f.
struct LandmarkRows {
  SlamLandmark landmark;  // linearised here
  Eigen::Matrix<double, Eigen::Dynamic, 3> R;
  Eigen::MatrixXd H;  // rows x dimension of the state
  Eigen::VectorXd r;
  Eigen::MatrixXd noise;  // covariance of n
};

class VisionUpdate {
 public:
  VisionUpdate(const EstimatorConfig& config, int state_capacity);

  // Observations of SLAM features in the newest clone (2 degrees of freedom each).
  void update_slam(State& state, const std::vector<TrackObservation>& observations,
                   UpdateReport& report);

  // `features`: tracks to be used and forgotten; `candidates`: tracks that may become SLAM
  // features, best first, at most `free_slots` of them. One stacked update for all. The tracks
  // whose observations must not count again are returned: those that were used or gated.
  [[nodiscard]] std::vector<std::uint64_t> update_tracks(
      State& state, const std::vector<const Track*>& features,
      const std::vector<const Track*>& candidates, int free_slots, UpdateReport& report);

  // The first visual update: all tracks and all clones at once, iterated (Gauss-Newton on prior and
  // bearings), because before it neither depth nor scale is known and one linearisation would be
  // wrong for good. `guess`: where to begin, of the same window; what has been found unless kNone.
  // Commits it only when depths have become known, or it is `impatient`.
  enum class Start {
    kNone,     // the tracks do not agree, or say nothing of depths
    kTooSoon,  // they agree, but depths are not known well enough to be linearised for good
    kMade,
  };
  [[nodiscard]] Start start(State& state, State& guess, const std::vector<const Track*>& tracks,
                            bool impatient, UpdateReport& report);

  // Before the start: the state as the tracks have it if what is in sight lies about equally far
  // away, however far that is. Hovering shows no depth, but turning, and that it hovers. Not to be
  // kept: the same bearings are used again at the start. Nothing if the tracks do not agree.
  [[nodiscard]] std::optional<State> glimpse(const State& state,
                                             const std::vector<const Track*>& tracks);

  // The upper rows of a track, two of one with a single bearing. `guess_world` (m): where to
  // linearise a track that cannot be triangulated on its own. Nothing when it was seen in no
  // keyframe of the window.
  [[nodiscard]] std::optional<LandmarkRows> upper_rows(const State& state, const Track& track,
                                                       const Eigen::Vector3d& guess_world);

  // Inverse depth of a track, seen from the present pose. Nothing when it is not known.
  [[nodiscard]] std::optional<TrackDepth> depth_of(const State& state, const Track& track);

  // Moves the anchor of every SLAM feature off this clone; one that cannot be moved is dropped.
  void reanchor(State& state, int leaving_clone, UpdateReport& report) const;

 private:
  // A track's whitened rows: columns [feature 3 | window | residual], window as in State.
  struct Linearized {
    SlamLandmark landmark;
    int rows = 0;
  };
  enum class Outcome { kOk, kUntriangulated, kGated };

  // Rows of a track, feature projected out; false when it cannot be triangulated.
  [[nodiscard]] bool linearize(const State& state, const Track& track, Linearized& result);
  // The same about a given point; false when it is behind a camera.
  [[nodiscard]] bool linearize_at(const State& state, const Track& track,
                                  const Eigen::Vector3d& p_world, Linearized& result);
  // The rows before the feature is projected out.
  [[nodiscard]] bool fill_rows(const State& state, const Track& track,
                               const Eigen::Vector3d& p_world, Linearized& result);
  // Before the start: by what one iteration moves the window and the logarithm of the common depth.
  struct GlimpseStep {
    Eigen::VectorXd window;
    double log_depth = 0;
  };
  // Before the start: a track's point, and what says how it moves with the window and the common
  // depth: R df + H dx + h d(log depth) = r.
  struct GlimpsedPoint {
    // x/z, y/z, 1/z in the anchor's camera; zero: not known yet.
    Eigen::Vector3d in_anchor = Eigen::Vector3d::Zero();
    Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
    Eigen::Matrix<double, 3, Eigen::Dynamic> rows;  // [H | r | h]
    void move(const GlimpseStep& moved);
  };
  // Rows of a track whose depth is only known to be like that of the others; the last column is for
  // the logarithm of that common depth.
  [[nodiscard]] bool linearize_glimpsed(const State& state, const Track& track, double depth,
                                        GlimpsedPoint& point, Linearized& result);
  // linearize(), judged: is its depth known, does it agree with the state?
  Outcome examine(const State& state, const Track& track, double max_depth_error,
                  Linearized& result);
  // Medians over the tracks that were stacked: mean squared whitened residual, depth error.
  struct StartQuality {
    int tracks = 0;
    double median_squared_residual = 0, median_depth_error = 0;
  };
  [[nodiscard]] StartQuality stack_for_start(const State& state,
                                             const std::vector<const Track*>& tracks);
  [[nodiscard]] StartQuality stack_for_glimpse(const State& state,
                                               const std::vector<const Track*>& tracks,
                                               double depth, std::vector<GlimpsedPoint>& points);
  enum class Points { kKept, kEquallyFar };  // from one iteration to the next
  [[nodiscard]] static bool shows_relief(const std::vector<GlimpsedPoint>& points);
  struct Glimpse {
    State state;
    // Of points that are kept: some are nearer than others. Equally far: it fits beyond doubt.
    bool convincing = false;
  };
  [[nodiscard]] std::optional<Glimpse> glimpse(const State& state,
                                               const std::vector<const Track*>& tracks,
                                               Points mode);
  [[nodiscard]] std::optional<GlimpseStep> step_glimpse(const State& prior, State& current);
  // of_depth * d(log depth) + H dx = r
  struct DepthRow {
    double of_depth = 0, r = 0;
    Eigen::RowVectorXd H;
  };
  [[nodiscard]] DepthRow take_depth_out(int columns);
  enum class Depth { kInScale, kInMetres };
  double depth_error(const State& state, const Linearized& feature,
                     Depth depth = Depth::kInScale) const;
  void augment_at_start(State& state, const std::vector<const Track*>& tracks,
                        UpdateReport& report);
  bool passes_gate(const State& state, int rows) const;
  void stack_rows(int rows, int columns);
  void augment(State& state, const Linearized& feature);
  bool apply_stack(State& state);

  EstimatorConfig config_;
  ChiSquareGate gate_;
  EkfUpdate slam_update_, stacked_update_;
  Eigen::Matrix<double, Eigen::Dynamic, 3> H_feature_;  // work space: one track
  Eigen::MatrixXd H_track_;                             // one track: [window residual]
  Eigen::MatrixXd stack_;                               // all tracks: [window residual]
  int stack_rows_ = 0;
  std::vector<View> views_;
};

}  // namespace covey
