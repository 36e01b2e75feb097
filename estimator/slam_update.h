// SPDX-License-Identifier: Apache-2.0
//
// SLAM features: landmarks of the state, seen again in the present image (paper, eq. 7, 8 and 15).
#pragma once

#include <vector>

#include "estimator/chi_square.h"
#include "estimator/config.h"
#include "estimator/ekf_update.h"
#include "estimator/estimator.h"
#include "estimator/state.h"

namespace covey {

class SlamUpdate {
 public:
  SlamUpdate(const EstimatorConfig& config, int state_capacity);

  // Their observations in the newest clone, 2 degrees of freedom each. Features that did not fit
  // several times in a row are dropped.
  void update(State& state, const std::vector<TrackObservation>& observations,
              UpdateReport& report);

 private:
  EstimatorConfig config_;
  ChiSquareGate gate_;
  EkfUpdate update_;
};

// Moves the anchor of every SLAM feature off this clone; one that cannot be moved is dropped.
void reanchor(State& state, int leaving_clone);

}  // namespace covey
