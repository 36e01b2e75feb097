// SPDX-License-Identifier: Apache-2.0
//
// What tracks tell the filter: MSCKF features, whose track ended or whose oldest clone is about to
// leave, and tracks that become SLAM features.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "estimator/chi_square.h"
#include "estimator/config.h"
#include "estimator/estimator.h"
#include "estimator/state.h"
#include "estimator/track_rows.h"
#include "estimator/track_store.h"

namespace covey {

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

  // `features`: tracks to be used and forgotten; `candidates`: tracks that may become SLAM
  // features, best first, at most `free_slots` of them. One stacked update for all. The tracks
  // whose observations must not count again are returned: those that were used or gated.
  [[nodiscard]] std::vector<std::uint64_t> update_tracks(
      State& state, const std::vector<const Track*>& features,
      const std::vector<const Track*>& candidates, int free_slots, UpdateReport& report);

  // Of tracks whose null-space rows have been used (VisionStart) and that go on: makes SLAM
  // features of them, so that what has been learnt about their depth is kept.
  void add_slam_features(State& state, const std::vector<const Track*>& tracks,
                         UpdateReport& report);

  // The upper rows of a track, two of one with a single bearing. `guess_world` (m): where to
  // linearise a track that cannot be triangulated on its own. Nothing when it was seen in no
  // keyframe of the window.
  [[nodiscard]] std::optional<LandmarkRows> upper_rows(const State& state, const Track& track,
                                                       const Eigen::Vector3d& guess_world);

  // Inverse depth of a track, seen from the present pose. Nothing when it is not known.
  [[nodiscard]] std::optional<TrackDepth> depth_of(const State& state, const Track& track);

 private:
  enum class Outcome { kOk, kUntriangulated, kGated };

  // Into `rows_`: is the track's depth known, does it agree with the state?
  [[nodiscard]] Outcome examine(const State& state, const Track& track, double max_depth_error);
  [[nodiscard]] bool passes_gate(const State& state) const;
  void augment(State& state) const;

  EstimatorConfig config_;
  ChiSquareGate gate_;
  TrackRows rows_;
  RowStack stack_;
};

}  // namespace covey
