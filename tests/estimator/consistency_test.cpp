// SPDX-License-Identifier: Apache-2.0
//
// Is the filter as good as it says? Normalised estimation error squared (NEES) over many simulated
// flights, each from a start and a calibration disturbed by the covariance that the filter is told.
// Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation" (2001),
// section 5.4.2.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <thread>
#include <vector>

#include "tests/estimator/filter_run.h"

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
  double position_nees = 0, orientation_nees = 0;  // sums
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

void expect_consistent(const std::vector<FilterRun>& runs) {
  constexpr double kDegreesOfFreedom = 3, kLeast = 0.7, kMost = 1.4;
  const auto bins = binned(runs);
  for (int i = 0; i < kBins; ++i) {
    const TimeBin& bin = bins[static_cast<std::size_t>(i)];
    SCOPED_TRACE("seconds " + std::to_string(i * kDuration_s / kBins) + " to " +
                 std::to_string((i + 1) * kDuration_s / kBins));
    ASSERT_GT(bin.count, 0);
    const double position = bin.position_nees / bin.count / kDegreesOfFreedom;
    const double orientation = bin.orientation_nees / bin.count / kDegreesOfFreedom;
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

}  // namespace
}  // namespace covey
