// SPDX-License-Identifier: Apache-2.0
//
// One flight of real agents over the laboratory's network, by the clock: they meet, fly, some are
// killed and started again. Or they only meet and stay in touch.
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "apps/config_file.h"
#include "apps/drone_network.h"
#include "apps/lab_experiment.h"
#include "apps/team.h"

namespace covey {

struct LabFlightPlan {
  std::vector<AgentConfig> agents;  // in the order of the network's drones
  bool fly = true;
  double settle_s = 0, hold_s = 0;
  double pace = 1;
  LabKills kills;
  std::uint64_t seed = 1;
};

struct LabKill {
  std::string drone;
  double at_s = 0;  // of the clock, since the start of the flight
  // Since its process was started again until it and all others heard each other. Nothing if it
  // did not happen before the end.
  std::optional<double> met_again_s;
};

struct LabMemory {
  std::string drone;
  double at_s = 0;  // of the clock, since the start of the flight
  double mib = 0;   // own memory of the drone and of its link's process
};

struct LabFlightResult {
  // Drones that were killed on purpose are not among those that ended early.
  FlightResult flight;
  double start_ms = 0;                // steady_ms() when the first image was due
  TimeNs first_ns = 0;                // stamp of the first image
  std::optional<double> met_after_s;  // since the last drone's link was open
  std::vector<LabKill> kills;
  std::vector<LabMemory> memory;  // of drones that fly, with every sign of progress
  double longest_silence_s = 0;   // of a drone that flew, between two signs of progress
  // Frames of each drone: until all had met, and from then on (where nobody flies, from when they
  // had settled) until the end.
  std::vector<PortCounts> meeting, together;
  double together_s = 0;  // s of the clock
};

// Throws std::runtime_error when a drone cannot start. Ctrl-C stops all of them in good order.
[[nodiscard]] LabFlightResult fly_in_lab(
    const LabFlightPlan& plan, DroneNetwork& network,
    const std::function<void(const FlightProgress&)>& on_progress);

// In order, s of the clock since the start; none in a flight that is too short to come back to.
[[nodiscard]] std::vector<double> kill_moments(const LabKills& kills, double flight_s,
                                               std::uint64_t seed);

// Field by field.
[[nodiscard]] PortCounts difference(const PortCounts& later, const PortCounts& earlier);

}  // namespace covey
