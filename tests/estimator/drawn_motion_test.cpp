// SPDX-License-Identifier: Apache-2.0
//
// Motions, scenes, cameras and IMUs drawn at random: slow flight, rare images and few tracks among
// them.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "sim/feature_simulation.h"
#include "sim/random.h"
#include "tests/estimator/filter_run.h"
#include "tests/estimator/flown_heading.h"

namespace covey {
namespace {

constexpr double kDuration_s = 30;

double logarithmic(Random& random, double least, double most) {
  return least * std::exp(random.uniform(0, 1) * std::log(most / least));
}

// One coordinate: three waves.
struct Waves {
  std::array<double, 3> amplitude, phase, frequency_hz;

  [[nodiscard]] double at(double t) const {
    double sum = 0;
    for (std::size_t i = 0; i < 3; ++i) {
      sum += amplitude[i] * std::sin(2 * M_PI * frequency_hz[i] * t + phase[i]);
    }
    return sum;
  }
};

Waves draw_waves(Random& random, double frequency_hz) {
  Waves waves{};
  for (std::size_t i = 0; i < 3; ++i) {
    waves.amplitude[i] = random.gaussian();
    waves.phase[i] = random.uniform(0, 2 * M_PI);
    waves.frequency_hz[i] = frequency_hz * random.uniform(0.5, 1.5);
  }
  return waves;
}

// Within `reach_m` of the middle, at about `speed`.
Trajectory draw_motion(Random& random, double reach_m, double speed, double height_m) {
  const double frequency_hz = std::min(0.6, speed / (2 * M_PI * reach_m));
  std::array<Waves, 3> place;
  for (Waves& waves : place) waves = draw_waves(random, frequency_hz);
  const Waves yaw = draw_waves(random, frequency_hz / 2);
  const double swing = random.uniform(0, 0.6);
  const double rate = random.uniform(0, 1) < 0.3 ? random.uniform(-0.5, 0.5) : 0;  // rad/s
  double farthest = 0;
  for (double t = 0; t < kDuration_s; t += 0.05) {
    farthest = std::max(farthest, std::hypot(place[0].at(t), place[1].at(t)));
  }
  const double scale = reach_m / farthest;
  const auto motion = [=](double t) -> Heading {
    return {
        {scale * place[0].at(t), scale * place[1].at(t), height_m + 0.3 * scale * place[2].at(t)},
        swing * yaw.at(t) + rate * t};
  };
  return flown(motion, kDuration_s);
}

FeatureScenario draw_scenario(std::uint64_t seed) {
  Random random(seed, 0xd4a0);
  constexpr std::array kScenes = {Scenario::kRoom, Scenario::kMarsYard, Scenario::kCastleAround,
                                  Scenario::kCastleParallel};
  FeatureScenario drawn;
  drawn.flight.scenario = kScenes[seed % kScenes.size()];
  const bool in_room = drawn.flight.scenario == Scenario::kRoom;
  const double reach_m = logarithmic(random, 0.3, in_room ? 1.3 : 6);
  const double speed = logarithmic(random, 0.15, 8);
  drawn.flight.recorded = {
      draw_motion(random, reach_m, speed, in_room ? 1.5 : 2.5 + 0.3 * reach_m)};
  drawn.camera.rate_hz = logarithmic(random, 10, 60);
  drawn.camera.pixel_sigma = logarithmic(random, 0.03, 0.7);
  drawn.camera.loss_share = logarithmic(random, 0.005, 0.08);
  drawn.camera.max_tracks = static_cast<int>(logarithmic(random, 40, 200));
  if (random.uniform(0, 1) < 0.4) drawn.imu = icm20608();
  return drawn;
}

struct Flown {
  double speed = 0;  // m/s, mean
  MeanNees nees;
};

Flown fly_drawn(std::uint64_t seed) {
  const FeatureScenario scenario = draw_scenario(seed);
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  config.calibrate_extrinsics = config.calibrate_time_offset = config.calibrate_intrinsics = true;
  config.extrinsics_sigma_m = config.extrinsics_sigma_rad = 0.001;
  const DroneFeatures drone = simulate_features(scenario, seed).drones[0];
  const FilterRun run = run_filter(drone, config, seed);
  EXPECT_TRUE(run.covariance_valid);
  EXPECT_GT(run.errors.back().time_s, kDuration_s / 2);
  return {drone.trajectory.length_m(0, drone.trajectory.duration_s()) / kDuration_s,
          mean_nees_once_started(run)};
}

double geometric_mean(const std::vector<Flown>& flights, double MeanNees::*value) {
  double sum = 0;
  for (const Flown& flown : flights) sum += std::log(flown.nees.*value);
  return std::exp(sum / static_cast<double>(flights.size()));
}

// Slow flights and others when this was written: position 1.6 and 1.0, orientation 1.2 and 1.0; 14
// and 1.2, 1.2 and 1.1 as long as the scale was spread over positions, velocities and depths.
TEST(DrawnMotion, TheFilterKnowsHowWrongItIsAlsoInSlowFlight) {
  constexpr std::uint64_t kFlights = kEnoughForStatistics ? 48 : 2;
  constexpr double kSlow = 0.5;  // m/s
  std::vector<Flown> slow, others;
  for (std::uint64_t seed = 1; seed <= kFlights; ++seed) {
    const Flown flown = fly_drawn(seed);
    (flown.speed < kSlow ? slow : others).push_back(flown);
  }
  if (!kEnoughForStatistics) return;
  EXPECT_LT(geometric_mean(slow, &MeanNees::position), 2.2);
  EXPECT_LT(geometric_mean(slow, &MeanNees::orientation), 1.6);
  EXPECT_GT(geometric_mean(others, &MeanNees::position), 0.7);
  EXPECT_LT(geometric_mean(others, &MeanNees::position), 1.4);
  EXPECT_LT(geometric_mean(others, &MeanNees::orientation), 1.4);
}

}  // namespace
}  // namespace covey
