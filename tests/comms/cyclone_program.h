// SPDX-License-Identifier: Apache-2.0
//
// What programs of tests that speak with Cyclone DDS have in common.
#pragma once

#include <array>
#include <cstddef>
#include <iostream>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "dds/dds.h"
#include "tests/comms/input_ended.h"

namespace covey {

inline constexpr int kCycloneReaderDepth = 64;  // samples of all writers together

inline dds_entity_t require(dds_entity_t entity, const std::string& what) {
  if (entity < 0) throw std::runtime_error("no " + what + ": " + dds_strretcode(entity));
  return entity;
}

template <typename Wire, typename Handle>
void for_each(dds_entity_t reader, const Handle& handle) {
  std::array<void*, kCycloneReaderDepth> samples{};
  std::array<dds_sample_info_t, kCycloneReaderDepth> infos{};
  const dds_return_t count =
      dds_take(reader, samples.data(), infos.data(), samples.size(), kCycloneReaderDepth);
  for (dds_return_t i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (infos[at].valid_data) handle(*static_cast<const Wire*>(samples[at]));
  }
  if (count > 0) dds_return_loan(reader, samples.data(), count);
}

// One line for the test.
inline void tell(const nlohmann::json& line) { std::cout << line.dump() << std::endl; }

}  // namespace covey
