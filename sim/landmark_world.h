// SPDX-License-Identifier: Apache-2.0
//
// Landmarks on the surfaces of a scenario: facades and ground, a rocky yard, the walls of a room.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "sim/scenario_motion.h"

namespace covey {

struct SurfaceLandmark {
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();
  Eigen::Vector3d normal_world = Eigen::Vector3d::UnitZ();  // seen only from this side
};

// `count` 0: as many as the scenario needs for about a hundred in view. A room (and recorded
// motion) gets walls around the flights.
[[nodiscard]] std::vector<SurfaceLandmark> landmark_world(Scenario scenario,
                                                          const std::vector<DronePlan>& flights,
                                                          int count, std::uint64_t seed);

}  // namespace covey
