// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "comms/convert.h"

namespace covey {

// What a chunk of a recording holds. `compression`: "" or "none", "bz2", "lz4", "zstd"; `size`: of
// what was packed. Throws Unreadable (comms/byte_fields.h).
[[nodiscard]] Bytes unpacked(const std::string& compression, const Bytes& packed,
                             std::uint64_t size);

}  // namespace covey
