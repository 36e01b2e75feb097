// SPDX-License-Identifier: Apache-2.0
//
// A run whose drones flew each by itself, in containers or on vehicles: their folders are all that
// is known of them.
#pragma once

#include <filesystem>
#include <string>

#include "apps/run_summary.h"

namespace covey {

struct CollectedRun {
  std::filesystem::path run;      // holds a folder for each drone
  std::filesystem::path dataset;  // what they flew: ground truth to evaluate against
  std::string config_file;        // what they were set to; empty: the defaults
};

// Since the drone that writes to `folder` last said that it flies.
[[nodiscard]] double silent_for_s(const std::filesystem::path& folder);

struct Wait {
  std::filesystem::file_time_type start;
  double silence_s = 0;
  // Besides, for the first drone: its container starts, it reads its dataset and makes its folder.
  double start_s = 60;
};

// Whether the drone that writes to `folder` has written its summary since the wait began, or
// nothing for so long. An older summary is of an earlier flight into the same folder, whose drone
// may be about to start again.
[[nodiscard]] bool has_ended(const std::filesystem::path& folder, const Wait& wait);

// Returns once all drones that are there have ended, when none has come in time, or when a stop was
// asked for.
void wait_for_end(const CollectedRun& collected, const Wait& wait);

// As a team does at its end: evaluates and writes RUN/summary.json. A drone without a summary is
// reported as ended early. Throws std::runtime_error when no drone has left anything.
RunSummary summarize_collected(const CollectedRun& collected);

}  // namespace covey
