// SPDX-License-Identifier: Apache-2.0
#include "comms/rtps_check.h"

#include <cstring>

namespace covey {
namespace {

constexpr std::size_t kHeaderBytes = 20;             // of the message
constexpr std::size_t kSubmessageHeaderBytes = 4;    // id, flags, length of what follows
constexpr std::uint8_t kLittleEndian = 0x01;         // flag
constexpr std::uint8_t kPad = 0x01, kInfoTs = 0x09;  // ids of what may be empty
constexpr std::uint8_t kStatistics = 0x80;           // id, eProsima's own

std::size_t length_in(const std::uint8_t* header) {
  const bool little = (header[1] & kLittleEndian) != 0;
  const std::size_t low = header[little ? 2 : 3], high = header[little ? 3 : 2];
  return high << 8 | low;
}

// Without its header.
std::size_t length_of(const std::uint8_t* header, std::size_t left) {
  const std::size_t length = length_in(header);
  const bool to_the_end = length == 0 && header[0] != kPad && header[0] != kInfoTs;
  return to_the_end ? left : length;
}

}  // namespace

bool is_rtps_message(const std::uint8_t* bytes, std::size_t size) {
  if (size < kHeaderBytes || std::memcmp(bytes, "RTPS", 4) != 0) return false;
  std::size_t at = kHeaderBytes;
  while (at < size) {
    if (size - at < kSubmessageHeaderBytes) return false;
    const std::uint8_t* header = bytes + at;
    at += kSubmessageHeaderBytes;
    const std::size_t length = length_of(header, size - at);
    if (length > size - at) return false;
    at += length;
    if (at < size && (length % 4 != 0 || header[0] == kStatistics)) return false;
  }
  return true;
}

}  // namespace covey
