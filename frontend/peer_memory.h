// SPDX-License-Identifier: Apache-2.0
//
// The newest keyframes that peers have told, in the order in which they came, and where they lie in
// the own world. Comparing views with them costs no bytes.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <deque>
#include <string>

#include "estimator/measurements.h"

namespace covey {

class PeerMemory {
 public:
  struct Entry {
    PeerKeyframe keyframe;
    CameraView view;  // in the own world
  };

  explicit PeerMemory(std::size_t capacity) : capacity_(capacity) {}

  [[nodiscard]] const std::deque<Entry>& entries() const { return entries_; }

  // Each once, and only those with landmarks. One of a new flight ends the sender's earlier one:
  // all of that is forgotten. `T_world_cam`: in the own world.
  void remember(const PeerKeyframe& message, const Eigen::Isometry3d& T_world_cam);
  void forget(const std::string& peer);
  // The peer's world is taken to lie elsewhere than until now.
  void place_anew(const std::string& peer, const Eigen::Isometry3d& T_own_peer);

 private:
  std::size_t capacity_;
  std::deque<Entry> entries_;
};

}  // namespace covey
