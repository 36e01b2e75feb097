// SPDX-License-Identifier: Apache-2.0
//
// Drones that start in one world start where they say. If one does not, what its peers tell it fits
// nowhere: it flies as if alone, and nothing else would say why.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "estimator/drift_filter.h"
#include "frontend/collaborator.h"

namespace covey {

// What became of the peers' messages, since the start: of answers, and how much was learnt from
// what peers have found of own keyframes.
struct PeerCounts {
  std::int64_t fused = 0, gated = 0, rejected = 0;
  std::int64_t learned = 0;
};

// What to ask the user, of a drone whose peers' answers hardly ever fit. Nothing if enough of them
// do, or too few have come to tell.
[[nodiscard]] std::optional<std::string> doubt_of_start(const PeerCounts& counts,
                                                        const CollaboratorReport& collaboration);

// Of a peer whose world has moved: DriftFilter::moves.
[[nodiscard]] std::string words_on_move(const std::string& peer, const DriftFilter& team);

}  // namespace covey
