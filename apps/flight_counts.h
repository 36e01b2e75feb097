// SPDX-License-Identifier: Apache-2.0
//
// What a drone's images came to, summed over its flight.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>

#include "apps/pipeline.h"

namespace covey {

struct FlightCounts {
  std::int64_t frames = 0, dropped = 0;  // images flown, and left out
  std::int64_t track_sightings = 0, tracks_begun = 0;
  UpdateReport filter;  // sums
  int zero_velocity_images = 0, reinitialized = 0;
  int repeated_images = 0, uniform_images = 0;  // frozen ones among the repeated

  void add(const ImageResult& result);
};

// "filter" of a drone's own summary.
[[nodiscard]] nlohmann::json filter_json(const FlightCounts& counts);

}  // namespace covey
