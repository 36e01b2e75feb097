// SPDX-License-Identifier: Apache-2.0
//
// Generated types to serialised samples and back. Inside this room only.
#pragma once

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <cstddef>
#include <exception>

#include "comms/checks.h"
#include "comms/convert.h"

namespace covey {

inline constexpr std::size_t kCdrHeaderBytes = 4;  // encapsulation

template <typename Wire>
Bytes to_cdr(const Wire& wire) {
  using eprosima::fastcdr::Cdr;
  Bytes bytes(kCdrHeaderBytes + Wire::getCdrSerializedSize(wire));
  eprosima::fastcdr::FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  wire.serialize(cdr);
  bytes.resize(cdr.getSerializedDataLength());
  return bytes;
}

// What can be told without trusting a single length field.
inline Problem problem_with_cdr(const Bytes& bytes, std::size_t max_bytes) {
  if (bytes.size() > max_bytes) return "sample too large";
  if (bytes.size() <= kCdrHeaderBytes) return "sample too short";
  // CDR_BE is 0 0, CDR_LE is 0 1; what follows are options that nobody uses.
  if (bytes[0] != 0 || bytes[1] > 1) return "unknown encapsulation";
  return {};
}

// `bytes` must have passed problem_with_cdr().
template <typename Wire>
Decoded<Wire> from_cdr(const Bytes& bytes) {
  using eprosima::fastcdr::Cdr;
  constexpr std::size_t kMaxPaddingBytes = 3;  // DDS pads a sample to a multiple of four
  // FastBuffer knows no const; deserialising does not write.
  eprosima::fastcdr::FastBuffer buffer(
      reinterpret_cast<char*>(const_cast<std::uint8_t*>(bytes.data())), bytes.size());
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  Wire wire;
  try {
    cdr.read_encapsulation();
    wire.deserialize(cdr);
  } catch (const std::exception&) {
    return Rejected{"sample ends too early"};
  }
  if (bytes.size() - cdr.getSerializedDataLength() > kMaxPaddingBytes)
    return Rejected{"sample has bytes left over"};
  return wire;
}

}  // namespace covey
