// SPDX-License-Identifier: Apache-2.0
//
// What a datagram must satisfy before Fast DDS sees it, and what can be told of it from outside.
// Debian's build of 2.9 keeps its assertions: one datagram whose submessage of statistics does not
// stand at its very end ends the process.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

namespace covey {

// An RTPS header, then submessages that fit one after the other (RTPS 2.2, 8.3.4), each at a
// multiple of four bytes; statistics last.
[[nodiscard]] bool is_rtps_message(const std::uint8_t* bytes, std::size_t size);

// Of an RTPS message: tells who is there, and nothing else (8.5.3). The farewell of one who goes is
// none.
[[nodiscard]] bool is_announcement(const std::uint8_t* bytes, std::size_t size);

// Of an RTPS message: without the statistics at its end, if there are any.
[[nodiscard]] std::size_t size_without_statistics(const std::uint8_t* bytes, std::size_t size);

// Of an RTPS message: the GUID prefix of who sent it.
[[nodiscard]] std::array<std::uint8_t, 12> sender_of(const std::uint8_t* bytes);

}  // namespace covey
