// SPDX-License-Identifier: Apache-2.0
//
// What a datagram must satisfy before Fast DDS sees it. Debian's build of 2.9 keeps its assertions:
// one datagram whose submessage of statistics does not stand at its very end ends the process.
#pragma once

#include <cstddef>
#include <cstdint>

namespace covey {

// An RTPS header, then submessages that fit one after the other (RTPS 2.2, 8.3.4), each at a
// multiple of four bytes; statistics last.
[[nodiscard]] bool is_rtps_message(const std::uint8_t* bytes, std::size_t size);

}  // namespace covey
