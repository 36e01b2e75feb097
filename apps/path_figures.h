// SPDX-License-Identifier: Apache-2.0
//
// How far a simulated drone's odometry was from the truth, and whether it knew.
#pragma once

#include <vector>

#include "estimator/measurements.h"

namespace covey {

struct FlownPath {
  std::vector<Odometry> odometry;
  std::vector<Pose> truth;  // one for each
};

struct PathFigures {
  double aligned_m = 0;         // RMSE of the position, SE3-aligned
  double unaligned_m = 0;       // the same in the common world
  double position_nees = 0;     // mean; 3 for an honest filter
  double orientation_nees = 0;  // the same
};

[[nodiscard]] PathFigures figures_of(const FlownPath& path);

// Normalised estimation error squared at one image.
struct NeesSample {
  double position = 0, orientation = 0;  // 3 degrees of freedom each
};
[[nodiscard]] NeesSample nees_of(const Odometry& odometry, const Pose& truth);

}  // namespace covey
