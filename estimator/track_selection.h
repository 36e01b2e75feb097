// SPDX-License-Identifier: Apache-2.0
//
// Which tracks a visual update uses.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "estimator/state.h"
#include "estimator/track_store.h"

namespace covey {

// At most `limit` of them; tracks of one length stay in order.
[[nodiscard]] std::vector<const Track*> longest_first(std::vector<const Track*> tracks,
                                                      int limit = std::numeric_limits<int>::max());

// To be used and forgotten, the longest first: those that have ended, and those whose oldest view,
// `leaving`, is about to leave the window.
[[nodiscard]] std::vector<const Track*> ended_or_leaving(const TrackStore& store,
                                                         std::optional<std::uint64_t> leaving,
                                                         int limit);

// That may become SLAM features: of those that go on and are not `taken`, first those from cells of
// the image in which fewest SLAM features were when they were anchored, the longest first.
[[nodiscard]] std::vector<const Track*> slam_candidates(const TrackStore& store, const State& state,
                                                        const std::vector<const Track*>& taken);

}  // namespace covey
