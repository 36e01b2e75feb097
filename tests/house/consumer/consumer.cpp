// SPDX-License-Identifier: Apache-2.0
//
// Somebody else's program: the installed estimator, started from a known pose.
#include <iostream>

#include "estimator/estimator.h"

int main() {
  covey::Estimator estimator{covey::EstimatorConfig{}};
  estimator.initialize(covey::InitialState{});
  std::cout << "initialised: " << estimator.initialized() << '\n';
  return estimator.initialized() ? 0 : 1;
}
