// SPDX-License-Identifier: Apache-2.0
//
// Who flies where in each scenario, and how its camera is mounted.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "estimator/config.h"
#include "sim/trajectory.h"

namespace covey {

enum class Scenario { kCastleAround, kCastleParallel, kMarsYard, kRoom };

// "castle_around", "castle_parallel", "mars_yard", "room"; nothing for another name.
[[nodiscard]] std::optional<Scenario> scenario_from_name(std::string_view name);
[[nodiscard]] std::string_view scenario_name(Scenario scenario);
[[nodiscard]] int default_agents(Scenario scenario);
[[nodiscard]] double default_duration_s(Scenario scenario);

struct FlightRequest {
  Scenario scenario = Scenario::kCastleAround;
  std::uint64_t seed = 1;
  int agents = 0;         // 0: the scenario's own number (or one for each recorded trajectory)
  double duration_s = 0;  // 0: the scenario's own (or the recorded one)
  double lap_m = 0;  // m, yard: length of everybody's lap, one in the flight; 0: the scenario's
  int legs = 1;  // so often duration_s, there and back along one path, at rest at both of its ends
  std::vector<Trajectory> recorded;  // flown instead of invented motion, one for each drone
};

struct DronePlan {
  std::string name;  // uav0, uav1, ...
  Trajectory trajectory;
  CameraExtrinsics extrinsics;
};

// Scene the motions are made for: castle about 30 m wide and centred at the origin, its facade at
// y = -15 m; ground at z = 0. Yard: ground about z = 0, laps around the origin. Room: own flights
// stay within 2.6 x 2.1 m of the origin and between 0.7 and 2.3 m height. Throws std::runtime_error
// for a request that cannot be flown.
[[nodiscard]] std::vector<DronePlan> plan_flights(const FlightRequest& request);

// Camera looking along the imu's x axis (imu: x forward, y left, z up), pitched down.
[[nodiscard]] CameraExtrinsics mounted_camera(double pitch_down);
// cam0 of the EuRoC dataset (Burri et al., 2016): what recorded EuRoC motion is flown with.
[[nodiscard]] CameraExtrinsics euroc_camera();

}  // namespace covey
