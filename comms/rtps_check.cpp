// SPDX-License-Identifier: Apache-2.0
#include "comms/rtps_check.h"

#include <cstring>

namespace covey {
namespace {

constexpr std::size_t kHeaderBytes = 20;  // of the message
constexpr std::size_t kPrefixInHeader = 8;
constexpr std::size_t kSubmessageHeaderBytes = 4;    // id, flags, length of what follows
constexpr std::uint8_t kLittleEndian = 0x01;         // flag
constexpr std::uint8_t kPad = 0x01, kInfoTs = 0x09;  // ids of what may be empty
constexpr std::uint8_t kStatistics = 0x80;           // id, eProsima's own
constexpr std::uint8_t kInfoDst = 0x0e, kData = 0x15;
constexpr std::uint8_t kHasData = 0x04;                          // flag of kData: not only a key
constexpr std::size_t kWriterInData = 12;                        // from the submessage's header on
constexpr std::uint8_t kAnnouncer[] = {0x00, 0x01, 0x00, 0xc2};  // every participant's, by its id

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

// With its header; to the end if it is damaged.
std::size_t whole_length(const std::uint8_t* header, std::size_t left) {
  if (left < kSubmessageHeaderBytes) return left;
  return kSubmessageHeaderBytes + length_of(header, left - kSubmessageHeaderBytes);
}

bool is_announcing(const std::uint8_t* data, std::size_t left) {
  return left >= kWriterInData + sizeof(kAnnouncer) && (data[1] & kHasData) != 0 &&
         std::memcmp(data + kWriterInData, kAnnouncer, sizeof(kAnnouncer)) == 0;
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

bool is_announcement(const std::uint8_t* bytes, std::size_t size) {
  bool announces = false;
  for (std::size_t at = kHeaderBytes; at < size; at += whole_length(bytes + at, size - at)) {
    const std::uint8_t* header = bytes + at;
    if (header[0] == kData) {
      if (!is_announcing(header, size - at)) return false;
      announces = true;
    } else if (header[0] != kInfoTs && header[0] != kInfoDst && header[0] != kStatistics) {
      return false;
    }
  }
  return announces;
}

std::size_t size_without_statistics(const std::uint8_t* bytes, std::size_t size) {
  for (std::size_t at = kHeaderBytes; at < size; at += whole_length(bytes + at, size - at))
    if (bytes[at] == kStatistics) return at;
  return size;
}

std::array<std::uint8_t, 12> sender_of(const std::uint8_t* bytes) {
  std::array<std::uint8_t, 12> prefix{};
  std::memcpy(prefix.data(), bytes + kPrefixInHeader, prefix.size());
  return prefix;
}

}  // namespace covey
