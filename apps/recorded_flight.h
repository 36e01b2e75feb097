// SPDX-License-Identifier: Apache-2.0
//
// Recorded motion for the simulator, read with the same strictness as a dataset.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "sim/recorded_flight.h"

namespace covey {

// EuRoC csv files; `imu_csv` may be empty. Without the first `begin_s` of the ground truth. Throws
// std::runtime_error naming file and line, or the file that is over by then.
[[nodiscard]] RecordedFlight read_recorded_flight(const std::filesystem::path& ground_truth_csv,
                                                  const std::filesystem::path& imu_csv,
                                                  double begin_s = 0);

// What a command line names: of `imus` and `begins_s`, s, none or one for each trajectory.
struct RecordedFiles {
  std::vector<std::string> trajectories, imus;
  std::vector<double> begins_s;
};

// Throws std::runtime_error also where there is not one for each; `command`: who asks.
[[nodiscard]] std::vector<RecordedFlight> read_recorded_flights(const RecordedFiles& files,
                                                                const std::string& command);

}  // namespace covey
