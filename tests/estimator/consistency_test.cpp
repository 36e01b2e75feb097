// SPDX-License-Identifier: Apache-2.0
//
// Is the filter as good as it says? Normalised estimation error squared (NEES) over many simulated
// flights, each from a start and a calibration disturbed by the covariance that the filter is told.
// Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001),
// section 5.4.2.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <cmath>
#include <string>
#include <thread>
#include <vector>

#include "tests/estimator/filter_run.h"
#include "tests/estimator/flown_heading.h"

namespace covey {
namespace {

constexpr int kSeeds = kEnoughForStatistics ? 60 : 4;
constexpr int kThreads = 2;
constexpr double kDuration_s = 12;
constexpr int kBins = 8;  // of time
constexpr std::array<Scenario, 4> kScenarios{Scenario::kRoom, Scenario::kCastleAround,
                                             Scenario::kMarsYard, Scenario::kCastleParallel};

FilterRun run_seed(int seed, bool calibrate) {
  FeatureScenario scenario;
  scenario.flight.scenario = kScenarios[static_cast<std::size_t>(seed) % kScenarios.size()];
  scenario.flight.agents = 1;
  scenario.flight.duration_s = kDuration_s;
  scenario.camera.first_image_s = 0.1023;  // never on an IMU sample
  scenario.camera.outlier_share = seed % 2 == 0 ? 0.0 : 0.02;
  if (calibrate) scenario.camera.time_offset_s = 0.004;
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  config.calibrate_extrinsics = calibrate;
  config.calibrate_time_offset = calibrate;
  config.calibrate_intrinsics = calibrate;
  const FeatureSimulation simulation =
      simulate_features(scenario, static_cast<std::uint64_t>(seed));
  return run_filter(simulation.drones[0], config, static_cast<std::uint64_t>(seed));
}

std::vector<FilterRun> run_all(bool calibrate) {
  std::vector<FilterRun> runs(kSeeds);
  std::atomic<int> next{0};
  const auto work = [&] {
    for (int i = next++; i < kSeeds; i = next++) {
      runs[static_cast<std::size_t>(i)] = run_seed(i + 1, calibrate);
    }
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) threads.emplace_back(work);
  for (std::thread& thread : threads) thread.join();
  return runs;
}

struct TimeBin {
  double position_nees = 0, orientation_nees = 0, velocity_nees = 0;  // sums
  int count = 0;
};

std::array<TimeBin, kBins> binned(const std::vector<FilterRun>& runs) {
  std::array<TimeBin, kBins> bins{};
  for (const FilterRun& run : runs) {
    for (const ErrorSample& error : run.errors) {
      const int index = std::min(kBins - 1, static_cast<int>(error.time_s / kDuration_s * kBins));
      TimeBin& bin = bins[static_cast<std::size_t>(index)];
      bin.position_nees += error.position_nees;
      bin.orientation_nees += error.orientation_nees;
      bin.velocity_nees += error.velocity_nees;
      ++bin.count;
    }
  }
  return bins;
}

void expect_no_divergence(const std::vector<FilterRun>& runs) {
  for (std::size_t i = 0; i < runs.size(); ++i) {
    SCOPED_TRACE("seed " + std::to_string(i + 1));
    const FilterRun& run = runs[i];
    ASSERT_GT(run.errors.size(), 150u);
    EXPECT_EQ(run.reinitialized, 0);
    EXPECT_EQ(run.refused, 0);
    EXPECT_TRUE(run.covariance_valid);
    EXPECT_LT(run.errors.back().position_m, 2.0);
    EXPECT_LT(run.errors.back().orientation, 0.1);
  }
}

// Until depths are known they are taken for far, which claims to see less of the motion than there
// is to see: velocities of the first eighth are better than told.
void expect_consistent(const std::vector<FilterRun>& runs) {
  constexpr double kDegreesOfFreedom = 3, kLeast = 0.7, kMost = 1.4, kLeastAtFirst = 0.5;
  const auto bins = binned(runs);
  for (int i = 0; i < kBins; ++i) {
    const TimeBin& bin = bins[static_cast<std::size_t>(i)];
    SCOPED_TRACE("seconds " + std::to_string(i * kDuration_s / kBins) + " to " +
                 std::to_string((i + 1) * kDuration_s / kBins));
    ASSERT_GT(bin.count, 0);
    const double position = bin.position_nees / bin.count / kDegreesOfFreedom;
    const double orientation = bin.orientation_nees / bin.count / kDegreesOfFreedom;
    const double velocity = bin.velocity_nees / bin.count / kDegreesOfFreedom;
    EXPECT_GT(velocity, i == 0 ? kLeastAtFirst : kLeast)
        << "velocity is better than the filter says";
    EXPECT_LT(velocity, kMost) << "velocity is worse than the filter says";
    EXPECT_GT(position, kLeast) << "position is better than the filter says";
    EXPECT_LT(position, kMost) << "position is worse than the filter says";
    EXPECT_GT(orientation, kLeast) << "orientation is better than the filter says";
    EXPECT_LT(orientation, kMost) << "orientation is worse than the filter says";
  }
}

TEST(Consistency, ErrorsAreAsLargeAsTheCovarianceSays) {
  const std::vector<FilterRun> runs = run_all(false);
  expect_no_divergence(runs);
  if (kEnoughForStatistics) expect_consistent(runs);
}

TEST(Consistency, ErrorsAreAsLargeAsTheCovarianceSaysWithOnlineCalibration) {
  const std::vector<FilterRun> runs = run_all(true);
  expect_no_divergence(runs);
  if (kEnoughForStatistics) expect_consistent(runs);
}

// Way at a speed of one that is reached from rest after `rise_s`.
double started(double time_s, double rise_s) {
  if (time_s > rise_s) return time_s - rise_s / 2;
  return time_s / 2 - rise_s / (2 * M_PI) * std::sin(M_PI * time_s / rise_s);
}

// Motions that hardly show the scale for seconds.
Heading hovering(double t) {
  return {{0.02 * std::sin(1.3 * t), 0.02 * std::sin(1.7 * t), 0.015 * std::sin(2.1 * t)},
          0.01 * std::sin(1.9 * t)};
}

Heading sliding_slowly(double t) {
  return {{0.1 * started(t, 2), 0.05 * std::sin(0.3 * t), 0.02 * std::sin(0.5 * t)},
          0.05 * std::sin(0.2 * t)};
}

Heading turning(double t) {
  const double way = 0.3 * started(t, 1);
  return {{std::cos(way), std::sin(way), 0.1 * std::sin(0.7 * t)}, 0.8 * started(t, 1)};
}

// All there is to see is how the camera swings about the IMU.
Heading turning_on_the_spot(double t) {
  return {{0.01 * std::sin(1.1 * t), 0.02 * std::sin(0.9 * t), 0}, 0.8 * std::sin(0.8 * t)};
}

// At a quarter of a metre a second.
Heading wandering(double t) {
  return {{std::sin(0.25 * t), 0.6 * std::sin(0.37 * t), 1.5 + 0.2 * std::sin(0.45 * t)},
          0.3 * std::sin(0.2 * t)};
}

// At 0.15 m/s.
Heading drifting(double t) {
  return {{0.15 * t - 0.45, 0.1 * std::sin(0.8 * t), 1.2 + 0.05 * std::cos(t)},
          0.2 * std::sin(0.5 * t)};
}

// Mean NEES of the position over its degrees of freedom, once the filter has had time to start.
double mean_nees_of_gentle_flights(Heading (*motion)(double), double duration_s,
                                   double pixel_sigma) {
  constexpr int kFlights = kEnoughForStatistics ? 12 : 2;
  FeatureScenario scenario;
  scenario.flight.scenario = Scenario::kRoom;
  scenario.flight.recorded = {flown(motion, duration_s)};
  scenario.camera.rate_hz = 30;
  scenario.camera.pixel_sigma = pixel_sigma;
  EstimatorConfig config;
  config.calibrate_extrinsics = config.calibrate_time_offset = config.calibrate_intrinsics = true;
  config.extrinsics_sigma_m = config.extrinsics_sigma_rad = 0.001;
  double sum = 0;
  for (std::uint64_t seed = 1; seed <= kFlights; ++seed) {
    const FeatureSimulation simulation = simulate_features(scenario, seed);
    const FilterRun run = run_filter(simulation.drones[0], config, seed);
    EXPECT_EQ(run.reinitialized, 0);
    sum += mean_nees_once_started(run).position;
  }
  return sum / kFlights;
}

// What a gentle start, or slow flight, does not show of the scale is not believed to be known. 0.9,
// 1.2, 1.6, 1.4, 1.2, 0.9 and 2.3 when this was written; the first six 1.0, 3.7, 4.2, 11, 5.2 and
// 81 as long as the scale was spread over positions, velocities and depths.
TEST(Consistency, AGentleFlightTellsLittleOfTheScaleAndTheFilterKnows) {
  struct Case {
    Heading (*motion)(double);
    double duration_s, pixel_sigma, most;
  };
  for (const Case& flight :
       {Case{hovering, 6, 0.1, 1.5}, Case{sliding_slowly, 6, 0.1, 2}, Case{turning, 6, 0.1, 3},
        Case{wandering, 20, 0.1, 2}, Case{wandering, 20, 0.4, 2}, Case{sliding_slowly, 24, 0.03, 3},
        Case{turning_on_the_spot, 12, 0.1, 3.5}}) {
    const double nees =
        mean_nees_of_gentle_flights(flight.motion, flight.duration_s, flight.pixel_sigma);
    if (kEnoughForStatistics) {
      EXPECT_LT(nees, flight.most);
    }
  }
}

// Where no track lives long enough to tell the scale well, the drone flies with what there is
// rather than by the IMU alone: 0.030 m off after 6 s when this was written, and 1.8 m as long as
// it waited.
TEST(Consistency, ASlowDroneOfShortTracksStarts) {
  constexpr int kFlights = kEnoughForStatistics ? 12 : 2;
  FeatureScenario scenario;
  scenario.flight.scenario = Scenario::kRoom;
  scenario.flight.recorded = {flown(drifting, 6)};
  scenario.camera.rate_hz = 30;
  scenario.camera.pixel_sigma = 0.5;
  scenario.camera.loss_share = 0.1;  // tracks live for a third of a second
  double sum = 0;
  for (std::uint64_t seed = 1; seed <= kFlights; ++seed) {
    const FeatureSimulation simulation = simulate_features(scenario, seed);
    const FilterRun run = run_filter(simulation.drones[0], EstimatorConfig(), seed);
    EXPECT_GT(run.used, 0) << "flight " << seed;
    sum += run.errors.back().position_m;
  }
  if (kEnoughForStatistics) {
    EXPECT_LT(sum / kFlights, 0.08);
  }
}

}  // namespace
}  // namespace covey
