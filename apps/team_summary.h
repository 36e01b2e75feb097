// SPDX-License-Identifier: Apache-2.0
//
// From what the drones of a team left behind to the figures of the run.
#pragma once

#include <filesystem>
#include <string>

#include "apps/run_summary.h"
#include "apps/team.h"

namespace covey {

// A process that was killed may have left half a line in a file of its folder: takes it away.
void drop_incomplete_lines(const std::filesystem::path& folder);

// Evaluates each drone in RUN/<drone>/, adds its ground truth to the folder, writes
// RUN/summary.json.
RunSummary summarize_team(const TeamOptions& options, const FlightResult& flight,
                          const std::filesystem::path& dataset);

// For the terminal: one line per drone; with the errors of `alone`, if given, beside the team's.
[[nodiscard]] std::string team_table(const RunSummary& run, const RunSummary* alone);

}  // namespace covey
