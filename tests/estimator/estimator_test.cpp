// SPDX-License-Identifier: Apache-2.0
//
// What the filter does when its input is not as it should be.
#include "estimator/estimator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <optional>
#include <utility>
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

TEST(Estimator, TheImuIsAsNoisyAsItIsSaidToBeInFlight) {
  const auto covariance_with = [](double density_factor, double scale) {
    EstimatorConfig config;
    config.imu_noise.gyro_density *= density_factor;
    config.imu_noise.accel_density *= density_factor;
    config.imu_noise_scale = scale;
    Estimator estimator(config);
    estimator.initialize(start_at(0));
    add_still_imu(estimator, 0, 2);
    (void)estimator.pass_image(nanoseconds(2));
    return estimator.odometry().pose_covariance;
  };
  const Matrix6d told = covariance_with(2, 1);
  EXPECT_TRUE(covariance_with(1, 2).isApprox(told));
  EXPECT_FALSE(covariance_with(1, 1).isApprox(told));
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
  EXPECT_EQ(refused.out_of_order, 0);
  estimator.add_imu(still_sample(0.5));
  const UpdateReport taken = estimator.add_camera(image_at(0.9));
  EXPECT_EQ(taken.images_refused, 0);
  EXPECT_EQ(taken.out_of_order, 1);
}

// A drone on its way, seen by a filter that starts at the truth but for what it is told.
struct Flight {
  DroneFeatures drone;
  Estimator estimator;
};

Flight take_off(Scenario scene, std::uint64_t seed, bool calibrate) {
  FeatureScenario scenario;
  scenario.flight.scenario = scene;
  scenario.flight.agents = 1;
  scenario.flight.duration_s = 14;
  scenario.camera.first_image_s = 0.1023;
  FeatureSimulation simulation = simulate_features(scenario, seed);
  DroneFeatures& drone = simulation.drones.front();
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  config.calibrate_extrinsics = config.calibrate_time_offset = calibrate;
  config.extrinsics = disturbed_extrinsics(drone.extrinsics, config, seed);
  Flight flight{std::move(drone), Estimator(config)};
  flight.estimator.initialize(disturbed_start(flight.drone, flight.drone.truth.front().bias, seed));
  for (const ImuSample& sample : flight.drone.imu) flight.estimator.add_imu(sample);
  return flight;
}

double time_of(const DroneFeatures& drone, const CameraMeasurement& image) {
  return seconds_between(drone.imu.front().stamp_ns, image.stamp_ns);
}

TEST(Estimator, AnImageThatShowsNothingLeavesTheWindowAsItIs) {
  auto [drone, estimator] = take_off(Scenario::kCastleAround, 1, false);
  UpdateReport before;
  bool blind = false;
  for (const CameraMeasurement& image : drone.camera) {
    const double time_s = time_of(drone, image);
    if (time_s > 7) break;
    const bool was_blind = blind;
    blind = time_s > 5 && time_s < 6;
    const UpdateReport report =
        blind ? estimator.pass_image(image.stamp_ns) : estimator.add_camera(image);
    ASSERT_TRUE(report.propagated);
    EXPECT_EQ(estimator.odometry().stamp_ns, image.stamp_ns);
    if (blind) {
      EXPECT_EQ(report.clones, before.clones);
      EXPECT_EQ(report.slam_features, before.slam_features);
      const bool told = estimator.odometry().status == FilterStatus::kDegraded;
      EXPECT_TRUE(told || time_s < 5.6);
    } else if (was_blind) {
      EXPECT_GT(report.slam_used, 0) << "landmarks have waited";
    }
    before = report;
  }
  EXPECT_EQ(estimator.odometry().status, FilterStatus::kTracking);
  EXPECT_LT(compare(estimator.odometry(), drone).position_m, 0.3);
}

TEST(Estimator, LandmarksWaitThreeSecondsForAnImage) {
  auto [drone, estimator] = take_off(Scenario::kCastleAround, 1, false);
  int seen = 0;
  for (const CameraMeasurement& image : drone.camera) {
    const double blind_s = time_of(drone, image) - 3;
    if (blind_s <= 0) {
      seen = estimator.add_camera(image).slam_features;
    } else if (blind_s < 3.5) {
      const int waiting = estimator.pass_image(image.stamp_ns).slam_features;
      if (blind_s < 2.9) {
        EXPECT_EQ(waiting, seen) << blind_s;
      } else if (blind_s > 3.1) {
        EXPECT_EQ(waiting, 0) << blind_s;
      }
    } else {
      (void)estimator.add_camera(image);
    }
  }
  EXPECT_GT(seen, 0);
  EXPECT_FALSE(estimator.slam_tracks().empty()) << "it sees again";
}

// Landmarks that wait for the next image are news of how far the drone has drifted meanwhile, until
// that is more than one linearisation bears: of images that show nothing, or do not come at all.
TEST(Estimator, AfterTenSecondsWithoutAnImageItIsAsSureAsItMayBe) {
  constexpr int kSeeds = 4;
  for (const bool images_come : {true, false}) {
    SCOPED_TRACE(images_come);
    double nees = 0, worst_m = 0;
    for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
      auto [drone, estimator] = take_off(Scenario::kMarsYard, seed, false);
      for (const CameraMeasurement& image : drone.camera) {
        const double time_s = time_of(drone, image);
        const bool blind = time_s > 3 && time_s < 13;
        if (blind && !images_come) continue;
        const UpdateReport report =
            blind ? estimator.pass_image(image.stamp_ns) : estimator.add_camera(image);
        EXPECT_FALSE(report.reinitialized);
      }
      const ErrorSample error = compare(estimator.odometry(), drone);
      nees += error.position_nees / (3 * kSeeds);
      worst_m = std::max(worst_m, error.position_m);
    }
    EXPECT_LT(worst_m, 1);
    EXPECT_LT(nees, 3);
  }
}

// Of the recording, from one before `from_ns` to the last one by `to_ns`.
std::vector<ImuSample> samples_between(const DroneFeatures& drone, TimeNs from_ns, TimeNs to_ns) {
  std::vector<ImuSample> samples;
  for (const ImuSample& sample : drone.imu) {
    if (sample.stamp_ns <= from_ns) samples.clear();
    if (sample.stamp_ns <= to_ns) samples.push_back(sample);
  }
  return samples;
}

TEST(Estimator, PredictsWhatAnImageThatShowsNothingWouldTell) {
  auto [drone, estimator] = take_off(Scenario::kCastleAround, 1, false);
  for (const CameraMeasurement& image : drone.camera) {
    if (time_of(drone, image) > 3) break;
    (void)estimator.add_camera(image);
  }
  const Odometry before = estimator.odometry();
  const auto samples = samples_between(drone, before.stamp_ns, before.stamp_ns + nanoseconds(0.1));
  const Odometry predicted = estimator.predicted(samples);
  EXPECT_EQ(estimator.odometry().stamp_ns, before.stamp_ns) << "its state is as it was";
  EXPECT_EQ(estimator.predicted({samples.front()}).stamp_ns, before.stamp_ns);

  (void)estimator.pass_image(samples.back().stamp_ns);
  const Odometry passed = estimator.odometry();
  EXPECT_EQ(predicted.stamp_ns, passed.stamp_ns);
  EXPECT_LT((predicted.pose.p_world_imu - passed.pose.p_world_imu).norm(), 1e-9);
  EXPECT_LT(predicted.pose.q_world_imu.angularDistance(passed.pose.q_world_imu), 1e-9);
  EXPECT_LT((predicted.v_world_imu - passed.v_world_imu).norm(), 1e-9);
  // The filter linearises about its first estimates, and leaves out of what velocity tells of the
  // scale what may be noise.
  constexpr double kMost = 0.01;
  EXPECT_LT((predicted.pose_covariance - passed.pose_covariance).norm(),
            kMost * passed.pose_covariance.norm());
  EXPECT_LT((predicted.velocity_covariance - passed.velocity_covariance).norm(),
            kMost * passed.velocity_covariance.norm());
  EXPECT_GT(predicted.velocity_covariance.trace(), before.velocity_covariance.trace());
}

// Extrinsics off by a degree and a centimetre, a clock by 8 ms, focal lengths by half a percent.
TEST(Estimator, FindsWhatIsWrongWithTheCameraAndSaysHowSureThatIs) {
  constexpr double kMostSigma = 4;
  FeatureScenario scenario;
  scenario.flight.scenario = Scenario::kCastleAround;
  scenario.flight.agents = 1;
  scenario.flight.duration_s = 14;
  scenario.camera.time_offset_s = 0.008;
  const FeatureSimulation simulation = simulate_features(scenario, 3);
  const DroneFeatures& drone = simulation.drones.front();
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  config.calibrate_extrinsics = config.calibrate_time_offset = config.calibrate_intrinsics = true;
  config.extrinsics = drone.extrinsics;
  config.extrinsics.time_offset_s = 0;
  config.extrinsics.p_imu_cam.x() += 0.01;
  config.extrinsics.q_imu_cam = drone.extrinsics.q_imu_cam * exp_quaternion({0.01, -0.01, 0.01});
  IntrinsicsError wrong;
  wrong << 0.005, 0.005, -0.002, 0.002, 0.003, -0.003;

  Estimator estimator(config);
  estimator.initialize(disturbed_start(drone, drone.truth.front().bias, 3));
  for (const ImuSample& sample : drone.imu) estimator.add_imu(sample);
  for (const CameraMeasurement& image : drone.camera) {
    (void)estimator.add_camera(computed_with(wrong, image));
  }

  const CalibrationSigma sigma = estimator.calibration_sigma();
  const CameraExtrinsics found = estimator.extrinsics();
  const Eigen::Vector3d turn =
      log_quaternion(found.q_imu_cam.conjugate() * drone.extrinsics.q_imu_cam);
  EXPECT_LT(turn.norm(), 0.002);
  EXPECT_LT(turn.cwiseQuotient(sigma.theta_imu_cam).cwiseAbs().maxCoeff(), kMostSigma);
  EXPECT_NEAR(found.time_offset_s, 0.008, 0.0005);
  EXPECT_NEAR(found.time_offset_s, 0.008, kMostSigma * sigma.time_offset_s);
  const IntrinsicsError left = wrong - estimator.intrinsics_error();
  // The principal point hardly shows in so short a flight.
  EXPECT_LT(left.head<2>().cwiseAbs().maxCoeff(), 0.002);
  EXPECT_LT(left.cwiseQuotient(sigma.intrinsics).cwiseAbs().maxCoeff(), kMostSigma);
}

// The first image too was taken where the drone pointed at a moment that is not known exactly.
TEST(Estimator, WhoTurnsWhenItStartsIsNotSureWhereTheFirstImagePoints) {
  constexpr double kRate = 0.8, kSigma_s = 0.01;  // rad/s
  EstimatorConfig config;
  config.calibrate_time_offset = true;
  config.time_offset_sigma_s = kSigma_s;
  Estimator estimator(config);
  estimator.initialize(start_at(1));
  for (int i = 0; i <= 40; ++i) {
    ImuSample sample = still_sample(0.9 + i / kImuRate_hz);
    sample.gyro_imu.z() = kRate;
    estimator.add_imu(sample);
  }
  for (const double image_s : {1.0, 1.05}) {
    (void)estimator.add_camera(image_at(image_s));
    EXPECT_GT(estimator.camera()->covariance(5, 5), std::pow(kRate * kSigma_s, 2)) << image_s;
  }
}

// The camera's pose is that of its clone; what is not known of the extrinsics is not known of it.
TEST(Estimator, TheCameraIsNoBetterKnownThanItsExtrinsics) {
  auto [drone, estimator] = take_off(Scenario::kRoom, 2, true);
  EXPECT_FALSE(estimator.camera()) << "before the first image";
  for (const CameraMeasurement& image : drone.camera) {
    ASSERT_TRUE(estimator.add_camera(image).propagated);
    const std::optional<CameraEstimate> camera = estimator.camera();
    ASSERT_TRUE(camera);
    const Odometry odometry = estimator.odometry();
    const Pose truth =
        drone.trajectory.pose_at(seconds_between(drone.imu.front().stamp_ns, odometry.stamp_ns));
    const Eigen::Vector3d p_true =
        truth.p_world_imu + truth.q_world_imu * drone.extrinsics.p_imu_cam;
    const Eigen::Vector3d error = p_true - camera->T_world_cam.translation();
    const Eigen::Matrix3d P = camera->covariance.topLeftCorner<3, 3>();
    ASSERT_LT(error.dot(P.llt().solve(error)), 30) << "of 3 degrees of freedom";
  }
}

// For four seconds each image has tracks of its own: nothing contradicts the state, nothing can be
// used. What is seen then is taken for a batch, as at the start.
TEST(Estimator, AfterSecondsWithoutAFeatureItBeginsToSeeAnew) {
  constexpr int kBatch = 20;  // tracks, at least
  auto [drone, estimator] = take_off(Scenario::kCastleAround, 1, false);
  std::uint64_t fresh = 1'000'000;
  int first_used = 0;
  for (CameraMeasurement image : drone.camera) {
    const double time_s = time_of(drone, image);
    if (time_s > 4 && time_s < 8) {
      for (TrackObservation& track : image.tracks) track.track_id = fresh++;
    }
    const UpdateReport report = estimator.add_camera(image);
    EXPECT_FALSE(report.reinitialized);
    if (time_s > 4.7 && time_s < 8) {
      EXPECT_EQ(estimator.odometry().status, FilterStatus::kDegraded);
      EXPECT_EQ(report.slam_used + report.msckf_used, 0);
    }
    if (time_s > 8 && first_used == 0) first_used = report.slam_used + report.msckf_used;
  }
  EXPECT_GE(first_used, kBatch);
  EXPECT_EQ(estimator.odometry().status, FilterStatus::kTracking);
  EXPECT_LT(compare(estimator.odometry(), drone).position_nees, 30) << "of 3 degrees of freedom";
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
  auto [drone, estimator] = take_off(scene, seed, calibrate);
  Random random(seed, 0xbad);
  CorruptedFlight flight;
  for (CameraMeasurement image : drone.camera) {
    const double time_s = time_of(drone, image);
    if (time_s > kFrom_s && time_s < kTo_s) {
      for (TrackObservation& track : image.tracks) {
        track.bearing += 0.1 * random.gaussian_vector().head<2>();
      }
    }
    const UpdateReport report = estimator.add_camera(image);
    if (report.reinitialized) {
      ++flight.restarts;
      EXPECT_FALSE(estimator.camera()) << "nothing has been seen since";
      const Trajectory& truth = drone.trajectory;
      flight.turned =
          truth.pose_at(kFrom_s).q_world_imu.angularDistance(truth.pose_at(time_s).q_world_imu);
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
