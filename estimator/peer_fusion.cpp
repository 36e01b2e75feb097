// SPDX-License-Identifier: Apache-2.0
#include "estimator/peer_fusion.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "estimator/track_selection.h"

namespace covey {
namespace {

using TrackPointers = std::vector<const Track*>;

// Those that are no SLAM features and seen in the window, longest first.
TrackPointers matched_tracks(const TrackStore& store, const KeyframeMatch& match, int limit) {
  TrackPointers tracks;
  for (const LandmarkMatch& landmark : match.matches) {
    const Track* track = store.find(landmark.track_id);
    if (track != nullptr && !track->observations.empty()) tracks.push_back(track);
  }
  return longest_first(std::move(tracks), limit);
}

// `tracks`: whose upper rows may be used.
SharedKeyframe shared_keyframe(const State& state, VisionUpdate& vision, const KeyframeMatch& match,
                               const TrackPointers& tracks, PeerReport& report) {
  SharedKeyframe keyframe;
  keyframe.other = match.other;
  keyframe.T_world_other = match.own.T_world_cam * match.T_other_own.inverse();
  for (const LandmarkMatch& pair : match.matches) {
    std::optional<SharedLandmark> landmark = landmark_of(pair);
    if (!landmark) {
      ++report.uninformative;
      continue;
    }
    const int index = state.find_landmark(pair.track_id);
    const auto track = std::find_if(tracks.begin(), tracks.end(), [&](const Track* candidate) {
      return candidate->id == pair.track_id;
    });
    std::optional<LandmarkRows> rows;
    if (index >= 0) {
      rows = rows_of(state, index);
    } else if (track != tracks.end()) {
      rows = vision.upper_rows(state, **track, keyframe.T_world_other * landmark->p_other);
    }
    if (!rows) {
      ++report.unknown_track;
      continue;
    }
    landmark->own = *rows;
    keyframe.landmarks.push_back(*landmark);
  }
  return keyframe;
}

}  // namespace

PeerReport fuse_match(const FilterParts& filter, const KeyframeMatch& match, const PeerGate& gate,
                      int max_tracks) {
  State trial = filter.state;
  trial.merge_scale();  // a peer speaks of metres
  const TrackPointers tracks = matched_tracks(filter.store, match, max_tracks);
  UpdateReport null_space;
  (void)filter.vision.update_tracks(trial, tracks, {}, 0, null_space);
  PeerReport report;
  const SharedKeyframe keyframe = shared_keyframe(trial, filter.vision, match, tracks, report);
  const PeerReport fused = update_from_peer(trial, keyframe, gate);
  report.used += fused.used;
  report.gated += fused.gated;
  report.invalid += fused.invalid;
  report.uninformative += fused.uninformative;
  if (report.used == 0) return report;
  filter.state = std::move(trial);
  filter.state.separate_scale();
  for (const Track* track : tracks) filter.store.forget_observations(track->id);
  return report;
}

}  // namespace covey
