// SPDX-License-Identifier: Apache-2.0
//
// The check of every datagram, under libFuzzer. What it lets pass it must let pass with one more
// submessage in front, too: it may not depend on where a submessage stands.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <vector>

#include "comms/rtps_check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (!covey::is_rtps_message(data, size)) return 0;
  constexpr std::ptrdiff_t kHeaderBytes = 20;
  std::vector<std::uint8_t> longer(data, data + size);
  const std::vector<std::uint8_t> timestamp = {0x09, 1, 8, 0, 1, 2, 3, 4, 5, 6, 7, 8};
  longer.insert(longer.begin() + kHeaderBytes, timestamp.begin(), timestamp.end());
  if (!covey::is_rtps_message(longer.data(), longer.size())) std::abort();
  return 0;
}
