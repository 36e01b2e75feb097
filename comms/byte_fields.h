// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>

#include "comms/convert.h"

namespace covey {

class Unreadable : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// Fields of a file or message one after the other, little-endian, without padding, as MCAP and ROS
// 1 have them. Throws Unreadable where there are fewer bytes than that. `bytes` outlive it.
class ByteFields {
 public:
  explicit ByteFields(const Bytes& bytes) : bytes_(bytes) {}

  [[nodiscard]] bool at_end() const { return at_ == bytes_.size(); }
  template <typename Unsigned>
  Unsigned number() {
    const std::uint8_t* const first = next(sizeof(Unsigned));
    std::uint64_t value = 0;
    for (std::size_t i = sizeof(Unsigned); i-- > 0;) value = value << 8U | first[i];
    return static_cast<Unsigned>(value);
  }
  double real() {
    const auto bits = number<std::uint64_t>();
    double value = 0;
    std::memcpy(&value, &bits, sizeof(value));
    return value;
  }
  // After their length in four bytes.
  std::string text() {
    const auto size = number<std::uint32_t>();
    const std::uint8_t* const first = next(size);
    return {first, first + size};
  }
  Bytes bytes(std::uint64_t size) {
    const std::uint8_t* const first = next(size);
    return {first, first + size};
  }
  Bytes rest() { return bytes(bytes_.size() - at_); }

 private:
  const std::uint8_t* next(std::uint64_t size) {
    if (size > bytes_.size() - at_) throw Unreadable("fields end too early");
    const std::uint8_t* const first = bytes_.data() + at_;
    at_ += size;
    return first;
  }

  const Bytes& bytes_;
  std::size_t at_ = 0;
};

}  // namespace covey
