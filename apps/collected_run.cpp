// SPDX-License-Identifier: Apache-2.0
#include "apps/collected_run.h"

#include <spdlog/spdlog.h>

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

double seconds_since(fs::file_time_type moment) {
  return std::chrono::duration<double>(fs::file_time_type::clock::now() - moment).count();
}

bool has_summary_since(const fs::path& folder, fs::file_time_type start) {
  std::error_code absent;
  const auto written = fs::last_write_time(folder / kAgentSummaryFile, absent);
  return !absent && written >= start;
}

bool all_have_ended(const CollectedRun& collected, const Wait& wait) {
  const std::vector<DroneFolder> drones = drones_that_flew(collected);
  return !drones.empty() && std::all_of(drones.begin(), drones.end(), [&](const auto& drone) {
    return has_ended(collected.run / drone.name, wait);
  });
}

bool anyone_there(const CollectedRun& collected) { return !drones_that_flew(collected).empty(); }

// Those that failed at their start never make their folders.
bool nobody_comes(const CollectedRun& collected, const Wait& wait) {
  return !anyone_there(collected) && seconds_since(wait.start) > wait.start_s + wait.silence_s;
}

void warn_of_earlier_flights(const CollectedRun& collected, const Wait& wait) {
  for (const DroneFolder& drone : drones_that_flew(collected)) {
    const fs::path folder = collected.run / drone.name;
    if (has_summary(folder) && !has_summary_since(folder, wait.start))
      spdlog::warn("{}: its summary was there before the wait began: of an earlier flight?",
                   drone.name);
  }
}

}  // namespace

double silent_for_s(const fs::path& folder) {
  const fs::path status = folder / kAgentStatusFile;
  std::error_code error;
  const auto last = fs::last_write_time(fs::exists(status) ? status : folder, error);
  if (error) throw std::runtime_error(folder.string() + ": no drone has been here");
  return seconds_since(last);
}

bool has_ended(const fs::path& folder, const Wait& wait) {
  if (has_summary_since(folder, wait.start)) return true;
  return seconds_since(wait.start) > wait.silence_s && silent_for_s(folder) > wait.silence_s;
}

void wait_for_end(const CollectedRun& collected, const Wait& wait) {
  constexpr std::chrono::milliseconds kPoll{200};
  if (!anyone_there(collected)) {
    spdlog::info("no drone of {} has made its folder in {} yet: waits up to {:.0f} s for the first",
                 collected.dataset.string(), collected.run.string(), wait.start_s + wait.silence_s);
  }
  while (!all_have_ended(collected, wait) && !nobody_comes(collected, wait) && !stop_requested())
    std::this_thread::sleep_for(kPoll);
  warn_of_earlier_flights(collected, wait);
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
  return summarize_team(team, flight, collected.dataset);
}

}  // namespace covey
