// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "comms/peer_link.h"

namespace covey {

// Throws std::runtime_error that names the setting, what is wrong with it and what to do.
void check(const LinkConfig& config);

// That the settings name, besides this one: one at each address. 0 if they do not tell.
[[nodiscard]] std::size_t other_drones(const LinkConfig& config);

}  // namespace covey
