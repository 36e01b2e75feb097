// SPDX-License-Identifier: Apache-2.0
//
// Which of this computer's addresses a link can use. Fast DDS looks once, when a link is made:
// an interface without a carrier gets no socket, and that link stays deaf and mute. So a link is
// made only when there is something to make it on.
#pragma once

#include <optional>
#include <set>
#include <string>
#include <vector>

#include "comms/own_addresses.h"
#include "comms/peer_link.h"

namespace covey {

struct LinkNetwork {
  std::set<std::string> usable;  // of link.interfaces; where that names none, all but the loopback
  std::string missing;  // what the settings want and is not usable, and why; empty: nothing is
};

[[nodiscard]] LinkNetwork link_network(const LinkConfig& config,
                                       const std::vector<OwnAddress>& own = own_addresses());

// With those interfaces alone that are usable. Nothing if link.interfaces names some and none is.
[[nodiscard]] std::optional<LinkConfig> on_what_is_there(LinkConfig config,
                                                         const LinkNetwork& network);

// Whether a link that uses those addresses would use more if it were made now. One that has gone
// may come back, and is used again without more ado.
[[nodiscard]] bool uses_too_little(const std::set<std::string>& used, const LinkNetwork& network);

}  // namespace covey
