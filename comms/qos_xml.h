// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "comms/peer_link.h"

namespace covey {

// What a link of this configuration asks of Fast DDS, as its XML profiles: a participant `covey`,
// and `request_writer`, `request_reader` and so on for each topic. Counting bytes and the fresh
// GUID prefix of each start are no XML's affair.
[[nodiscard]] std::string qos_xml(const LinkConfig& config);

}  // namespace covey
