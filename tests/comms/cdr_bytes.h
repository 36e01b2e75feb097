// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "comms/convert.h"

namespace covey {

// Little-endian CDR, written by hand: each value on a multiple of its size after the header.
class CdrBytes {
 public:
  template <typename Value>
  CdrBytes& put(Value value) {
    while ((bytes_.size() - 4) % sizeof(Value) != 0) bytes_.push_back(0);
    std::uint8_t raw[sizeof(Value)];
    std::memcpy(raw, &value, sizeof(Value));
    bytes_.insert(bytes_.end(), raw, raw + sizeof(Value));
    return *this;
  }
  CdrBytes& text(const std::string& value) {
    put(static_cast<std::uint32_t>(value.size() + 1));
    for (const char c : value) put(c);
    return put('\0');
  }
  CdrBytes& octets(const std::vector<std::uint8_t>& values) {
    put(static_cast<std::uint32_t>(values.size()));
    for (const std::uint8_t value : values) put(value);
    return *this;
  }
  CdrBytes& header(std::int32_t sec = 1'700'000'000, std::uint32_t nanosec = 123'456'789) {
    return put(sec).put(nanosec).text("camera");
  }
  [[nodiscard]] const Bytes& bytes() const { return bytes_; }

 private:
  Bytes bytes_{0, 1, 0, 0};
};

}  // namespace covey
