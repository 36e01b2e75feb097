// SPDX-License-Identifier: Apache-2.0
//
// A match with a peer's keyframe becomes a collaborative update (peer_update.h): own landmarks that
// are SLAM features count as such, those that are mere tracks by the upper rows of their bearings,
// after their null-space rows have updated the state (paper, section III-C).
#pragma once

#include "estimator/estimator.h"
#include "estimator/peer_update.h"
#include "estimator/state.h"
#include "estimator/track_store.h"
#include "estimator/vision_update.h"

namespace covey {

struct FilterParts {
  State& state;
  TrackStore& store;
  VisionUpdate& vision;
};

// On a copy, because a track whose rows are used must not be used again: filter and tracks stay as
// they are unless the peer helps. At most `max_tracks` that are no SLAM features.
[[nodiscard]] PeerReport fuse_match(const FilterParts& filter, const KeyframeMatch& match,
                                    const PeerGate& gate, int max_tracks);

}  // namespace covey
