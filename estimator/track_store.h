// SPDX-License-Identifier: Apache-2.0
//
// The bearings of tracks that are not (yet) SLAM features, by the clones that saw them: the paper's
// opportunistic tracks, out of which MSCKF and SLAM features are made.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

struct CloneObservation {
  std::uint64_t clone_id = 0;
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
  Eigen::Matrix2d whitening = 1e3 * Eigen::Matrix2d::Identity();    // see whitening()
  BearingByIntrinsics by_intrinsics = BearingByIntrinsics::Zero();  // TrackObservation
};

struct Track {
  std::uint64_t id = 0;
  bool seen_now = false;                       // in the present image
  std::vector<CloneObservation> observations;  // oldest first
  [[nodiscard]] const CloneObservation* find(std::uint64_t clone_id) const;
};

class TrackStore {
 public:
  // Marks every track as not seen; then each observation of the new image is added, the image used,
  // and what has ended dropped.
  void begin_image();
  void add(std::uint64_t track_id, const CloneObservation& observation);
  [[nodiscard]] const std::vector<Track>& tracks() const { return tracks_; }  // by id, ascending
  [[nodiscard]] const Track* find(std::uint64_t track_id) const;
  void forget_clone(std::uint64_t clone_id);         // its observations are gone
  void forget_track(std::uint64_t track_id);         // the track is gone
  void forget_observations(std::uint64_t track_id);  // used: each counts once
  void forget_all_observations();
  // Drops tracks that ended, all of them or those with fewer observations.
  void drop_ended(std::size_t shorter_than = std::numeric_limits<std::size_t>::max());
  void clear() { tracks_.clear(); }

 private:
  [[nodiscard]] std::vector<Track>::iterator lower_bound(std::uint64_t track_id);
  std::vector<Track> tracks_;
};

}  // namespace covey
