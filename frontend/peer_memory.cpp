// SPDX-License-Identifier: Apache-2.0
#include "frontend/peer_memory.h"

#include <algorithm>
#include <vector>

namespace covey {
namespace {

double mean_depth_of(const std::vector<PeerLandmark>& landmarks) {
  double depths = 0;
  for (const PeerLandmark& landmark : landmarks) depths += 1 / landmark.inverse_depth;
  return depths / static_cast<double>(landmarks.size());
}

}  // namespace

void PeerMemory::remember(const PeerKeyframe& message, const Eigen::Isometry3d& T_world_cam) {
  bool known = false, starts_anew = false;
  for (const Entry& entry : entries_) {
    if (entry.keyframe.sender != message.sender) continue;
    known |= entry.keyframe.pose.keyframe_id == message.pose.keyframe_id;
    starts_anew |= !are_of_one_flight(entry.keyframe.pose, message.pose);
  }
  if (starts_anew) {
    forget(message.sender);
  } else if (known) {
    return;
  }
  if (capacity_ == 0) return;
  if (entries_.size() >= capacity_) entries_.pop_front();
  entries_.push_back({message, {T_world_cam, mean_depth_of(message.landmarks)}});
}

void PeerMemory::forget(const std::string& peer) {
  entries_.erase(std::remove_if(entries_.begin(), entries_.end(),
                                [&](const Entry& entry) { return entry.keyframe.sender == peer; }),
                 entries_.end());
}

void PeerMemory::place_anew(const std::string& peer, const Eigen::Isometry3d& T_own_peer) {
  for (Entry& entry : entries_) {
    if (entry.keyframe.sender != peer) continue;
    entry.view.T_world_cam = T_own_peer * entry.keyframe.pose.T_world_cam;
  }
}

}  // namespace covey
