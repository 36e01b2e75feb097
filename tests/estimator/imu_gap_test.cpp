// SPDX-License-Identifier: Apache-2.0
//
// Samples of the IMU that never came: what the drone did meanwhile nobody knows, and the filter
// does not claim to.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <utility>

#include "sim/feature_simulation.h"
#include "tests/estimator/filter_run.h"

namespace covey {
namespace {

constexpr double kGapFrom_s = 6, kGapTo_s = 6.4, kJudgedUntil_s = 9;

DroneFeatures without_imu_for_a_moment(const FeatureScenario& scenario, std::uint64_t seed) {
  FeatureSimulation simulation = simulate_features(scenario, seed);
  DroneFeatures drone = std::move(simulation.drones.front());
  const TimeNs start_ns = drone.imu.front().stamp_ns;
  const auto lost = [&](const ImuSample& sample) {
    const double time_s = seconds_between(start_ns, sample.stamp_ns);
    return time_s > kGapFrom_s && time_s < kGapTo_s;
  };
  drone.imu.erase(std::remove_if(drone.imu.begin(), drone.imu.end(), lost), drone.imu.end());
  return drone;
}

// Images fall into the gap: more of them the faster they come.
class ImuGap : public testing::TestWithParam<double> {};

TEST_P(ImuGap, WhatHappensInItIsNotKnown) {
  constexpr double kMostNees = 1.5;  // over its degrees of freedom
  FeatureScenario scenario;
  scenario.camera.rate_hz = GetParam();
  scenario.flight.scenario = Scenario::kCastleAround;
  scenario.flight.agents = 1;
  scenario.flight.duration_s = kJudgedUntil_s;
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  MeanNees sum;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const FilterRun run = run_filter(without_imu_for_a_moment(scenario, seed), config, seed);
    EXPECT_EQ(run.reinitialized, 0);
    EXPECT_EQ(run.imu_gaps, 1);
    for (const ErrorSample& error : run.errors) {
      if (error.time_s < kGapFrom_s) continue;
      sum.position += error.position_nees / 3;
      sum.orientation += error.orientation_nees / 3;
      ++count;
    }
  }
  EXPECT_LT(sum.position / count, kMostNees);
  EXPECT_LT(sum.orientation / count, kMostNees);
}

INSTANTIATE_TEST_SUITE_P(ImagesPerSecond, ImuGap, testing::Values(15.0, 30.0, 60.0));

}  // namespace
}  // namespace covey
