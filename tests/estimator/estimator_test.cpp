// SPDX-License-Identifier: Apache-2.0
//
// What the filter does when its input is not as it should be.
#include "estimator/estimator.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "apps/disturbed_start.h"
#include "sim/feature_simulation.h"
#include "sim/random.h"
#include "tests/estimator/filter_run.h"

namespace covey {
namespace {

constexpr double kImuRate_hz = 200;

// A drone that stands still, level.
ImuSample still_sample(double time_s) {
  return {nanoseconds(time_s), Eigen::Vector3d::Zero(), {0, 0, EstimatorConfig().gravity}};
}

void add_still_imu(Estimator& estimator, double from_s, double to_s) {
  const int samples = static_cast<int>((to_s - from_s) * kImuRate_hz);
  for (int i = 0; i <= samples; ++i) estimator.add_imu(still_sample(from_s + i / kImuRate_hz));
}

InitialState start_at(double time_s) {
  InitialState start;
  start.stamp_ns = nanoseconds(time_s);
  return start;
}

CameraMeasurement image_at(double time_s) { return {nanoseconds(time_s), {}}; }

TEST(Estimator, ImuFromBeforeTheStartIsKeptForSecondsOnly) {
  const auto gaps_from = [](double start_s) {
    Estimator estimator(EstimatorConfig{});
    add_still_imu(estimator, 0, 60);
    estimator.initialize(start_at(start_s));
    return estimator.add_camera(image_at(60)).imu_gaps;
  };
  EXPECT_EQ(gaps_from(55), 0);
  EXPECT_EQ(gaps_from(20), 1) << "what would fill it is no longer there";
}

TEST(Estimator, ImuFromBeforeImagesThatShowNothingIsForgotten) {
  Estimator estimator(EstimatorConfig{});
  estimator.initialize(start_at(0));
  add_still_imu(estimator, 0, 60);
  for (int i = 1; i < 50; ++i) EXPECT_EQ(estimator.pass_image(nanoseconds(i)).imu_gaps, 0);
  estimator.initialize(start_at(1));
  EXPECT_EQ(estimator.add_camera(image_at(50)).imu_gaps, 1)
      << "what would fill it is no longer there";
}

TEST(Estimator, WithoutImuItDoesNotClaimToTrack) {
  Estimator estimator(EstimatorConfig{});
  estimator.initialize(start_at(0));
  add_still_imu(estimator, 0, 1);
  UpdateReport last;
  for (int i = 1; i <= 30; ++i) last = estimator.add_camera(image_at(1 + i / 30.0));
  EXPECT_FALSE(last.propagated);
  EXPECT_EQ(estimator.odometry().status, FilterStatus::kDegraded);
}

TEST(Estimator, AnImageThatIsRefusedIsNoImuSampleOutOfOrder) {
  Estimator estimator(EstimatorConfig{});
  estimator.initialize(start_at(0));
  add_still_imu(estimator, 0, 1);
  const UpdateReport refused = estimator.add_camera(image_at(2));
  EXPECT_EQ(refused.images_refused, 1);
  EXPECT_EQ(refused.out_of_order, 1);
  estimator.add_imu(still_sample(0.5));
  const UpdateReport taken = estimator.add_camera(image_at(0.9));
  EXPECT_EQ(taken.images_refused, 0);
  EXPECT_EQ(taken.out_of_order, 1);
}

// For three seconds all bearings are wrong, each otherwise. The drone flies on and turns.
struct CorruptedFlight {
  std::vector<ErrorSample> restarted;  // errors from the restart on
  int restarts = 0;
  double turned = 0;  // rad, from the last good image until the restart
  FilterStatus status = FilterStatus::kUninitialized;
};

CorruptedFlight fly_corrupted(Scenario scene, std::uint64_t seed, bool calibrate) {
  constexpr double kFrom_s = 4, kTo_s = 7;
  FeatureScenario scenario;
  scenario.flight.scenario = scene;
  scenario.flight.agents = 1;
  scenario.flight.duration_s = 14;
  scenario.camera.first_image_s = 0.1023;
  const FeatureSimulation simulation = simulate_features(scenario, seed);
  const DroneFeatures& drone = simulation.drones.front();
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  config.calibrate_extrinsics = config.calibrate_time_offset = calibrate;
  config.extrinsics = disturbed_extrinsics(drone.extrinsics, config, seed);
  Estimator estimator(config);
  estimator.initialize(disturbed_start(drone, drone.truth.front().bias, seed));
  for (const ImuSample& sample : drone.imu) estimator.add_imu(sample);
  Random random(seed, 0xbad);
  CorruptedFlight flight;
  for (CameraMeasurement image : drone.camera) {
    const double time_s = seconds_between(drone.imu.front().stamp_ns, image.stamp_ns);
    if (time_s > kFrom_s && time_s < kTo_s) {
      for (TrackObservation& track : image.tracks) {
        track.bearing += 0.1 * random.gaussian_vector().head<2>();
      }
    }
    const UpdateReport report = estimator.add_camera(image);
    if (report.reinitialized) {
      ++flight.restarts;
      const auto q_at = [&](double t) { return drone.trajectory.pose_at(t).q_world_imu; };
      flight.turned = q_at(kFrom_s).angularDistance(q_at(time_s));
    }
    if (flight.restarts > 0 && report.propagated) {
      flight.restarted.push_back(compare(estimator.odometry(), drone));
    }
  }
  flight.status = estimator.odometry().status;
  return flight;
}

// What the IMU tells of the turn is known when the bearings can be used again, and how well.
TEST(Estimator, ItRestartsWhereTheImuHasCarriedItAndSaysHowSureThatIs) {
  constexpr double kAbsurd = 30;  // of 3 degrees of freedom
  for (const std::uint64_t seed : {1, 2}) {
    for (const bool calibrate : {false, true}) {
      SCOPED_TRACE(testing::Message() << "seed " << seed << (calibrate ? ", calibrating" : ""));
      const CorruptedFlight flight = fly_corrupted(Scenario::kCastleAround, seed, calibrate);
      EXPECT_EQ(flight.restarts, 1);
      EXPECT_GT(flight.turned, 0.5) << "else the test tests nothing";
      EXPECT_EQ(flight.status, FilterStatus::kTracking);
      for (const ErrorSample& error : flight.restarted) {
        ASSERT_LT(error.position_nees, kAbsurd) << "at " << error.time_s << " s";
        ASSERT_LT(error.orientation_nees, kAbsurd) << "at " << error.time_s << " s";
      }
      EXPECT_LT(flight.restarted.back().position_m, 1);
    }
  }
}

}  // namespace
}  // namespace covey
