// SPDX-License-Identifier: Apache-2.0
//
// The figures of the report, as HTML: the tiles at its top and a table for errors, work, link and
// cameras.
#pragma once

#include <string>

#include "apps/report_data.h"

namespace covey {

// Each is empty when the run has nothing of the kind.
[[nodiscard]] std::string tiles(const RunData& data);
[[nodiscard]] std::string error_table(const RunData& data);
[[nodiscard]] std::string work_table(const RunData& data);
[[nodiscard]] std::string link_table(const RunData& data);
// What calibrating in flight has found; only of what was calibrated.
[[nodiscard]] std::string camera_table(const RunData& data);
// Where each drone has found its peers' worlds, if they started in worlds of their own.
[[nodiscard]] std::string world_table(const RunData& data);
// Of each drone's peers; empty if no statuses went both ways.
[[nodiscard]] std::string clock_table(const RunData& data);

// A coloured dot and the drone's name.
[[nodiscard]] std::string drone_label(const RunData& data, std::size_t index);

}  // namespace covey
