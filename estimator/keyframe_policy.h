// SPDX-License-Identifier: Apache-2.0
//
// Which images stay in the window: by motion, not by count. At 30 Hz neighbouring images are nearly
// the same view; a window of them has no baseline, and landmarks made from it no depth.
#pragma once

#include <optional>
#include <vector>

#include "estimator/observation_model.h"
#include "estimator/state.h"
#include "estimator/track_store.h"

namespace covey {

struct ViewChange {
  double parallax = 0;  // median motion of shared tracks, rotation taken out, normalised plane
  double shared = 0;    // share of the present tracks that the reference saw too
};

// Tracks of one image, ascending ids.
using TrackList = std::vector<TrackObservation>;

// Of observations with the same id the first.
[[nodiscard]] TrackList sorted_by_id(const std::vector<TrackObservation>& tracks);

[[nodiscard]] ViewChange compare_views(const TrackList& reference,
                                       const CameraPose& reference_camera, const TrackList& present,
                                       const CameraPose& present_camera);

// Whether the present image becomes a keyframe; `age_s`: since the last one.
[[nodiscard]] bool is_new_view(const EstimatorConfig& config, const ViewChange& change,
                               double age_s);

// Of a window that holds too many views, the clone to be dropped: that without which the fewest
// tracks become too short, and of these the one whose neighbours are closest in time. As long as
// tracks last, the window keeps its first view and covers ever more motion. Never one of the two
// newest; nothing if there are no others.
[[nodiscard]] std::optional<int> dispensable_view(const std::vector<Clone>& clones,
                                                  const TrackStore& store);

}  // namespace covey
