// SPDX-License-Identifier: Apache-2.0
#include "apps/collected_run.h"

#include <algorithm>
#include <chrono>
#include <stdexcept>
#include <thread>

#include "apps/agent.h"
#include "apps/dataset.h"
#include "apps/stop_signal.h"
#include "apps/team_summary.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

std::vector<DroneFolder> drones_that_flew(const CollectedRun& collected) {
  std::vector<DroneFolder> drones = find_drones(collected.dataset);
  const auto stayed = [&](const DroneFolder& drone) {
    return !fs::is_directory(collected.run / drone.name);
  };
  drones.erase(std::remove_if(drones.begin(), drones.end(), stayed), drones.end());
  return drones;
}

bool has_summary(const fs::path& folder) { return fs::exists(folder / kAgentSummaryFile); }

bool all_have_ended(const CollectedRun& collected, double silence_s) {
  const std::vector<DroneFolder> drones = drones_that_flew(collected);
  return !drones.empty() && std::all_of(drones.begin(), drones.end(), [&](const auto& drone) {
    const fs::path folder = collected.run / drone.name;
    return has_summary(folder) || silent_for_s(folder) > silence_s;
  });
}

}  // namespace

double silent_for_s(const fs::path& folder) {
  const fs::path status = folder / kAgentStatusFile;
  std::error_code error;
  const auto last = fs::last_write_time(fs::exists(status) ? status : folder, error);
  if (error) throw std::runtime_error(folder.string() + ": no drone has been here");
  return std::chrono::duration<double>(fs::file_time_type::clock::now() - last).count();
}

void wait_for_end(const CollectedRun& collected, double silence_s) {
  constexpr std::chrono::milliseconds kPoll{200};
  while (!all_have_ended(collected, silence_s) && !stop_requested())
    std::this_thread::sleep_for(kPoll);
}

RunSummary summarize_collected(const CollectedRun& collected) {
  AgentConfig config;
  if (!collected.config_file.empty()) config = read_config(collected.config_file);
  TeamOptions team;
  team.drones = drones_that_flew(collected);
  team.out = collected.run;
  team.mode = config.agent.mode;
  team.exchange = config.collaboration.exchange;
  team.init = config.initialisation.method;
  team.unknown_start = config.initialisation.own_world;
  if (team.drones.empty()) {
    throw std::runtime_error(collected.run.string() + " holds no folder of a drone of " +
                             collected.dataset.string() + ": is it where the drones wrote to?");
  }
  FlightResult flight;
  for (const DroneFolder& drone : team.drones) {
    if (!has_summary(collected.run / drone.name))
      flight.ended_early[drone.name] = "ended without a summary";
  }
  const fs::path dataset = fs::absolute(collected.dataset / "").lexically_normal();
  return summarize_team(team, flight, dataset.parent_path().filename().string());
}

}  // namespace covey
