// SPDX-License-Identifier: Apache-2.0
//
// What a peer's message must be to be used at all: a peer may be hostile, and what it says takes
// part in geometry.
#pragma once

#include <cstddef>

#include "estimator/measurements.h"

namespace covey {

inline constexpr std::size_t kMaxPeerLandmarks = 256;  // of a message

[[nodiscard]] bool is_plausible(const CameraView& view);
[[nodiscard]] bool is_well_formed(const PeerKeyframe& message);

}  // namespace covey
