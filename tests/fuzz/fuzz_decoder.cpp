// SPDX-License-Identifier: Apache-2.0
//
// One decoder, COVEY_DECODER, under libFuzzer. What it accepts must be fit to be sent again:
// encode() asserts that every check holds, and its sample must be of legal size.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <variant>

#include "comms/convert.h"
#include "comms/onboard_messages.h"
#include "comms/ros1_messages.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto decoded = covey::COVEY_DECODER(covey::Bytes(data, data + size));
  if (std::holds_alternative<covey::Rejected>(decoded)) return 0;
  if (covey::encode(std::get<0>(decoded)).size() > covey::kMaxFullMessageBytes) std::abort();
  return 0;
}
