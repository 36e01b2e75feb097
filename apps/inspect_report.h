// SPDX-License-Identifier: Apache-2.0
//
// What `covey inspect` leaves in its folder:
//
//   index.html            everything below on one page
//   summary.json          its figures
//   before_after_N.png    raw and calibrated image, N counts from 1 over the flight
//   tracks_N.png          tracks by kind on the calibrated and on the raw image (paper, figure 3)
//   harris.svg            how strongly corners respond in either (paper, figure 4)
//   tracks.svg            how many tracks there are over time
//   gain_offset.svg       what was found out about automatic gain, with the truth where it is known
//   field.png             the additive field at the end, and the true one where it is known
//
// Of a visual camera, and of raw images only, there is no calibration: before_after, gain_offset
// and field are missing.
#pragma once

#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>

#include "apps/inspection.h"

namespace covey {

struct InspectReport {
  std::string dataset, drone;
  Inspection inspection;
  std::optional<std::vector<ThermalTruthRecord>> truth;  // of simulated thermal cameras
};

[[nodiscard]] nlohmann::json inspect_summary(const InspectReport& report);

// Into a folder that exists. Throws std::runtime_error naming what cannot be written.
void write_inspect_report(const std::filesystem::path& folder, const InspectReport& report);
// Of a folder that exists: is that what lies there, and nothing else?
[[nodiscard]] bool is_inspect_report(const std::filesystem::path& folder);

}  // namespace covey
