// SPDX-License-Identifier: Apache-2.0
#include "estimator/track_store.h"

#include <algorithm>

namespace covey {

const CloneObservation* Track::find(std::uint64_t clone_id) const {
  for (const CloneObservation& observation : observations) {
    if (observation.clone_id == clone_id) return &observation;
  }
  return nullptr;
}

std::vector<Track>::iterator TrackStore::lower_bound(std::uint64_t track_id) {
  return std::lower_bound(tracks_.begin(), tracks_.end(), track_id,
                          [](const Track& track, std::uint64_t id) { return track.id < id; });
}

void TrackStore::begin_image() {
  for (Track& track : tracks_) track.seen_now = false;
}

void TrackStore::add(std::uint64_t track_id, const CloneObservation& observation) {
  auto place = lower_bound(track_id);
  if (place == tracks_.end() || place->id != track_id) {
    place = tracks_.insert(place, Track{track_id, true, {}});
  }
  place->seen_now = true;
  place->observations.push_back(observation);
}

const Track* TrackStore::find(std::uint64_t track_id) const {
  const auto place =
      std::lower_bound(tracks_.begin(), tracks_.end(), track_id,
                       [](const Track& track, std::uint64_t id) { return track.id < id; });
  return place != tracks_.end() && place->id == track_id ? &*place : nullptr;
}

void TrackStore::forget_clone(std::uint64_t clone_id) {
  for (Track& track : tracks_) {
    auto& list = track.observations;
    list.erase(std::remove_if(list.begin(), list.end(),
                              [&](const CloneObservation& o) { return o.clone_id == clone_id; }),
               list.end());
  }
}

void TrackStore::forget_track(std::uint64_t track_id) {
  const auto place = lower_bound(track_id);
  if (place != tracks_.end() && place->id == track_id) tracks_.erase(place);
}

void TrackStore::forget_observations(std::uint64_t track_id) {
  const auto place = lower_bound(track_id);
  if (place != tracks_.end() && place->id == track_id) place->observations.clear();
}

void TrackStore::forget_all_observations() {
  for (Track& track : tracks_) track.observations.clear();
}

void TrackStore::drop_ended(std::size_t shorter_than) {
  tracks_.erase(std::remove_if(tracks_.begin(), tracks_.end(),
                               [&](const Track& track) {
                                 return !track.seen_now && track.observations.size() < shorter_than;
                               }),
                tracks_.end());
}

}  // namespace covey
