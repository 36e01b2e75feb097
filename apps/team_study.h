// SPDX-License-Identifier: Apache-2.0
//
// What flying together is worth, on simulated features: against the number of drones, and with
// parts of it taken away.
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "sim/trajectory.h"

namespace covey {

struct StudyConfig {
  std::string scenario = "castle_around";
  double duration_s = 0;             // 0: the scenario's own, or that of the shortest recording
  int seeds = 3;                     // 1, 2, ...
  double pixel_sigma = 0.1;          // of a corner in one image, px; rendered ones claim it
  double corner_mismatch_px = 0.15;  // left between what two drones see of one landmark
  std::vector<Trajectory> recorded;  // flown in the room, one for each drone of the team
};

// Means over drones and seeds.
struct TeamFigures {
  double aligned_m = 0, unaligned_m = 0;           // RMSE of the position
  double position_nees = 0, orientation_nees = 0;  // over degrees of freedom
  // Share of the drones that are more than 3 % worse than alone.
  double worse_aligned = 0, worse_unaligned = 0;
};

struct ScalingPoint {
  int drones = 0;
  TeamFigures alone, together;
  // Per drone.
  double overlapping_peers = 0;     // of which a relative pose was used
  double question_bytes_per_s = 0;  // said once, whoever hears it
  double answer_bytes_per_s = 0;    // to those who asked
  double sent_bytes_per_s = 0;      // answers, and every question to each peer
  double fusion_ms_per_s = 0;       // CPU, relative poses and drift filter
};
// Told at every image how many of the flights of all drones are done; what it throws ends the
// study.
using OnFlight = std::function<void(std::size_t done, std::size_t flights)>;

// Throw std::runtime_error for a scenario that is not there.
[[nodiscard]] ScalingPoint study_team_size(const StudyConfig& config, int drones,
                                           const OnFlight& on_flight = {});

struct AblationRow {
  std::string variant;
  TeamFigures figures;
  double relative_poses = 0;  // used, per drone
};
// The first row is alone.
[[nodiscard]] std::vector<AblationRow> study_parts(const StudyConfig& config, int drones,
                                                   const OnFlight& on_flight = {});

}  // namespace covey
