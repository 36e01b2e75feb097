// SPDX-License-Identifier: Apache-2.0
//
// A team on this machine: one agent process per drone, paced, watched and stopped from here.
#pragma once

#include <filesystem>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/config_file.h"
#include "apps/dataset.h"

namespace covey {

struct TeamOptions {
  std::vector<DroneFolder> drones;
  std::filesystem::path out;
  FlightMode mode = FlightMode::kCollaborative;
  ExchangeMode exchange = ExchangeMode::kCompact;
  InitMethod init = InitMethod::kGroundTruth;
  bool unknown_start = false;  // each drone in a world of its own; peers' worlds are aligned
  Pace pace = Pace::kLockstep;
  double real_time_factor = 1;  // for Pace::kRate
  // Merged over the defaults for each drone; what is said above wins.
  nlohmann::json config = nlohmann::json::object();
  std::string config_name = "the team's configuration";  // in errors
};

struct FlightProgress {
  double flown_s = 0, total_s = 0;  // of the recording
  double elapsed_s = 0;             // since the start
};

struct FlightResult {
  double recorded_s = 0;  // of the recording, flown by those that reached the end
  double elapsed_s = 0;   // on the clock
  bool interrupted = false;
  std::map<std::string, std::string> ended_early;  // drone: why
};

// The configuration that one drone flies with.
[[nodiscard]] AgentConfig agent_config(const TeamOptions& options, const DroneFolder& drone,
                                       int domain);

// Throws std::runtime_error when a drone cannot start, or on Ctrl-C before they fly; `on_progress`
// is called from when they do. One that ends later is reported in the result, and the others go on;
// Ctrl-C then stops all of them in good order.
[[nodiscard]] FlightResult fly_team(const TeamOptions& options,
                                    const std::function<void(const FlightProgress&)>& on_progress);

}  // namespace covey
