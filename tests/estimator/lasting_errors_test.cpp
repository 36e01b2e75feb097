// SPDX-License-Identifier: Apache-2.0
//
// Errors of a tracked corner last for some images. Tracks with errors of a Gauss-Markov process,
// told to the filter as large as they are: taken for noise that is new in each image they would
// make it overconfident, because SLAM features are used in every image
// (EstimatorConfig::slam_noise_scale).
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <unordered_map>

#include "sim/random.h"
#include "tests/estimator/filter_run.h"

namespace covey {
namespace {

constexpr int kFlights = kEnoughForStatistics ? 24 : 1;
constexpr double kFreshPixels = 0.05, kLastingPixels = 0.2;
constexpr double kCorrelation = 0.85;  // with the image before, 30 images a second

void add_lasting_errors(DroneFeatures& drone, double sigma, std::uint64_t seed) {
  Random random(seed, 0x1a57);
  const auto draw = [&] { return Eigen::Vector2d(random.gaussian_vector().head<2>()); };
  std::unordered_map<std::uint64_t, Eigen::Vector2d> errors;  // by track, of sigma 1
  for (CameraMeasurement& image : drone.camera) {
    for (TrackObservation& track : image.tracks) {
      const auto [error, begins] = errors.try_emplace(track.track_id, Eigen::Vector2d::Zero());
      error->second = begins ? draw()
                             : Eigen::Vector2d(kCorrelation * error->second +
                                               std::sqrt(1 - kCorrelation * kCorrelation) * draw());
      track.bearing += sigma * error->second;
      track.covariance += sigma * sigma * Eigen::Matrix2d::Identity();
    }
  }
}

struct MeanNees {
  double position = 0, orientation = 0;  // over degrees of freedom
};

// Of the second half of the flights.
MeanNees fly(double slam_noise_scale) {
  constexpr double kDuration_s = 8, kDegreesOfFreedom = 3;
  MeanNees mean;
  int count = 0;
  for (std::uint64_t seed = 1; seed <= kFlights; ++seed) {
    FeatureScenario scenario;
    scenario.flight.scenario = seed % 2 == 0 ? Scenario::kCastleAround : Scenario::kRoom;
    scenario.flight.agents = 1;
    scenario.flight.duration_s = kDuration_s;
    scenario.camera.rate_hz = 30;
    scenario.camera.first_image_s = 0.1023;  // never on an IMU sample
    scenario.camera.pixel_sigma = kFreshPixels;
    FeatureSimulation simulation = simulate_features(scenario, seed);
    DroneFeatures& drone = simulation.drones[0];
    add_lasting_errors(drone, kLastingPixels / scenario.camera.focal_px, seed);
    EstimatorConfig config;
    config.imu_noise = scenario.imu.noise;
    config.slam_noise_scale = slam_noise_scale;
    for (const ErrorSample& error : run_filter(drone, config, seed).errors) {
      if (error.time_s < kDuration_s / 2) continue;
      mean.position += error.position_nees / kDegreesOfFreedom;
      mean.orientation += error.orientation_nees / kDegreesOfFreedom;
      ++count;
    }
  }
  mean.position /= count;
  mean.orientation /= count;
  return mean;
}

TEST(LastingErrors, DoNotMakeTheFilterOverconfident) {
  // The root of 1 + 2 (c + c^2 + ...), of the share of the variance that lasts.
  const double scale = std::sqrt((1 + kCorrelation) / (1 - kCorrelation));
  const MeanNees honest = fly(scale), naive = fly(1);
  ASSERT_TRUE(std::isfinite(honest.position) && std::isfinite(naive.position));
  if (!kEnoughForStatistics) return;
  // Keyframes are not so far apart that errors of window tracks would be quite independent.
  constexpr double kMost = 1.5, kTooMuch = 1.8;
  EXPECT_LT(honest.position, kMost);
  EXPECT_LT(honest.orientation, kMost);
  EXPECT_GT(naive.position, kTooMuch);
  EXPECT_GT(naive.orientation, kTooMuch);
}

}  // namespace
}  // namespace covey
