// SPDX-License-Identifier: Apache-2.0
//
// Fast DDS reports errors by printing to stdout, as often as a hostile packet makes it. Here they
// are counted and the last one is kept; apps decide what a person sees. Process-wide, as its log
// is.
#pragma once

#include <cstdint>
#include <string>

namespace covey {

struct DdsErrors {
  std::uint64_t count = 0;
  std::string last;
};

void keep_dds_errors();  // instead of printing them; may be called more than once

[[nodiscard]] DdsErrors dds_errors();

}  // namespace covey
