// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <netinet/in.h>

#include <set>

#include "comms/peer_link.h"

namespace covey {

// Throws std::runtime_error that names the setting, what is wrong with it and what to do.
void check(const LinkConfig& config);

// Where the settings say that they are, one at each address. Empty if they do not tell.
[[nodiscard]] std::set<in_addr_t> other_drones(const LinkConfig& config);

}  // namespace covey
