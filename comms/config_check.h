// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "comms/peer_link.h"

namespace covey {

// Throws std::runtime_error that names the setting, what is wrong with it and what to do.
void check(const LinkConfig& config);

}  // namespace covey
