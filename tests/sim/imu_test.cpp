// SPDX-License-Identifier: Apache-2.0
#include "sim/imu.h"

#include <gtest/gtest.h>

#include <cmath>

#include "estimator/so3.h"
#include "sim/scenario_motion.h"
#include "tests/sim/recorded_motion.h"

namespace covey {
namespace {

ImuSensor noise_free_imu() {
  ImuSensor sensor;
  sensor.noise = {0, 0, 0, 0};
  sensor.gyro_start_bias_sigma = 0;
  sensor.accel_start_bias_sigma = 0;
  return sensor;
}

struct Strapdown {
  Eigen::Vector3d p, v;
  Eigen::Quaterniond q;
};

// Integrates samples alone from a true start; Simpson's rule over pairs of intervals, the attitude
// in between by the mean rate of each half.
Strapdown dead_reckoned(const std::vector<ImuSample>& samples, const KinematicState& start,
                        std::size_t first, std::size_t last) {
  const Eigen::Vector3d gravity_world(0, 0, -9.81);
  Strapdown s{start.pose.p_world_imu, start.v_world_imu, start.pose.q_world_imu};
  for (std::size_t i = first; i + 2 <= last; i += 2) {
    const ImuSample &begin = samples[i], &middle = samples[i + 1], &end = samples[i + 2];
    const double half = seconds_between(begin.stamp_ns, middle.stamp_ns);
    const Eigen::Quaterniond q_middle =
        s.q * exp_quaternion(0.5 * half * (begin.gyro_imu + middle.gyro_imu));
    const Eigen::Quaterniond q_end =
        q_middle * exp_quaternion(0.5 * half * (middle.gyro_imu + end.gyro_imu));
    const Eigen::Vector3d a0 = s.q * begin.accel_imu + gravity_world;
    const Eigen::Vector3d a1 = q_middle * middle.accel_imu + gravity_world;
    const Eigen::Vector3d a2 = q_end * end.accel_imu + gravity_world;
    s.p += 2 * half * s.v + 2 * half * half / 3 * (a0 + 2 * a1);
    s.v += half / 3 * (a0 + 4 * a1 + a2);
    s.q = q_end.normalized();
  }
  return s;
}

void expect_integrates_back(const Trajectory& trajectory, double from_s, double seconds) {
  const std::vector<ImuSample> samples = simulate_imu(trajectory, noise_free_imu(), 1).samples;
  const auto first = static_cast<std::size_t>(from_s * 200 + 0.5);
  const auto last =
      std::min(first + static_cast<std::size_t>(seconds * 200 + 0.5), (samples.size() - 1) / 2 * 2);
  const Strapdown end = dead_reckoned(samples, trajectory.at(from_s), first, last);
  const KinematicState truth = trajectory.at(static_cast<double>(last) / 200);
  EXPECT_LT((end.p - truth.pose.p_world_imu).norm(), 0.02) << "m after " << seconds << " s";
  EXPECT_LT((end.v - truth.v_world_imu).norm(), 0.01) << "m/s after " << seconds << " s";
  EXPECT_LT(end.q.angularDistance(truth.pose.q_world_imu), 5e-4) << "rad";
}

TEST(Imu, NoiseFreeSamplesIntegrateBackToEveryScenariosMotion) {
  for (const Scenario scenario :
       {Scenario::kCastleAround, Scenario::kCastleParallel, Scenario::kMarsYard, Scenario::kRoom}) {
    FlightRequest request;
    request.scenario = scenario;
    for (const DronePlan& plan : plan_flights(request)) {
      SCOPED_TRACE(std::string(scenario_name(scenario)) + " " + plan.name);
      expect_integrates_back(plan.trajectory, 0, 10);
    }
  }
}

TEST(Imu, NoiseFreeSamplesIntegrateBackToRecordedMotion) {
  for (const char* file :
       {"trajectories/euroc_V2_01_easy.csv", "trajectories/euroc_MH_04_difficult.csv"}) {
    const auto motion = read_recorded(file);
    if (!motion) GTEST_SKIP() << "no recorded motion at " COVEY_SHARED_DATA_DIR;
    const Trajectory trajectory = Trajectory::from_poses(motion->times_s, motion->poses);
    for (const double from_s : {0.0, 20.0, 50.0}) {
      SCOPED_TRACE(std::string(file) + " from " + std::to_string(from_s) + " s");
      expect_integrates_back(trajectory, from_s, 10);
    }
  }
}

TEST(Imu, ReadsGravityUpwardsAtRest) {
  const Trajectory still = Trajectory::multirotor([](double) { return FlatOutput{}; }, 1);
  for (const ImuSample& sample : simulate_imu(still, noise_free_imu(), 1).samples) {
    EXPECT_LT((sample.accel_imu - Eigen::Vector3d(0, 0, 9.81)).norm(), 1e-9);
    EXPECT_LT(sample.gyro_imu.norm(), 1e-9);
  }
}

TEST(Imu, SamplesCoverTheFlightAtTheirRate) {
  const Trajectory still = Trajectory::multirotor([](double) { return FlatOutput{}; }, 2);
  const ImuRecording recording = simulate_imu(still, adis16448(), 1, 1'000'000'000);
  ASSERT_EQ(recording.samples.size(), 401u);
  ASSERT_EQ(recording.biases.size(), 401u);
  for (std::size_t i = 0; i < 401; ++i) {
    EXPECT_EQ(recording.samples[i].stamp_ns, 1'000'000'000 + static_cast<TimeNs>(i) * 5'000'000);
  }
  EXPECT_EQ(&recording.bias_at(0), &recording.biases[0]);
  EXPECT_EQ(&recording.bias_at(1'000'000'000 + 7'500'000), &recording.biases[1]);
  EXPECT_EQ(&recording.bias_at(9'000'000'000), &recording.biases[400]);
}

TEST(Imu, SameSeedSameSamplesAnotherSeedOthers) {
  const Trajectory still = Trajectory::multirotor([](double) { return FlatOutput{}; }, 1);
  const auto a = simulate_imu(still, adis16448(), 5), b = simulate_imu(still, adis16448(), 5);
  const auto c = simulate_imu(still, adis16448(), 6);
  for (std::size_t i = 0; i < a.samples.size(); ++i) {
    EXPECT_EQ(a.samples[i].gyro_imu, b.samples[i].gyro_imu);
    EXPECT_EQ(a.samples[i].accel_imu, b.samples[i].accel_imu);
    EXPECT_NE(a.samples[i].gyro_imu, c.samples[i].gyro_imu);
  }
}

TEST(Imu, NoiseAndBiasWalkHaveTheirDensities) {
  const Trajectory still = Trajectory::multirotor([](double) { return FlatOutput{}; }, 60);
  for (const ImuSensor& sensor : {adis16448(), icm20608()}) {
    const ImuRecording recording = simulate_imu(still, sensor, 3);
    double gyro2 = 0, accel2 = 0, gyro_step2 = 0, accel_step2 = 0;
    const std::size_t steps = recording.samples.size() - 1;
    for (std::size_t i = 0; i < steps; ++i) {
      const ImuBias &bias = recording.biases[i], &next = recording.biases[i + 1];
      const ImuSample& sample = recording.samples[i];
      gyro2 += (sample.gyro_imu - bias.gyro).squaredNorm();
      accel2 += (sample.accel_imu - bias.accel - Eigen::Vector3d(0, 0, 9.81)).squaredNorm();
      gyro_step2 += (next.gyro - bias.gyro).squaredNorm();
      accel_step2 += (next.accel - bias.accel).squaredNorm();
    }
    const double count = 3.0 * static_cast<double>(steps);
    // Continuous-time densities from discrete samples; 36 000 draws: 1.5 % is four sigma.
    const auto density = [&](double sum2) { return std::sqrt(sum2 / count / 200); };
    const auto walk = [&](double sum2) { return std::sqrt(sum2 / count * 200); };
    EXPECT_NEAR(density(gyro2) / sensor.noise.gyro_density, 1, 0.015);
    EXPECT_NEAR(density(accel2) / sensor.noise.accel_density, 1, 0.015);
    EXPECT_NEAR(walk(gyro_step2) / sensor.noise.gyro_random_walk, 1, 0.015);
    EXPECT_NEAR(walk(accel_step2) / sensor.noise.accel_random_walk, 1, 0.015);
  }
}

TEST(Imu, StartBiasesAreDrawnFromTheSeed) {
  const Trajectory still = Trajectory::multirotor([](double) { return FlatOutput{}; }, 1);
  double gyro2 = 0, accel2 = 0;
  constexpr int kSeeds = 400;
  for (int seed = 0; seed < kSeeds; ++seed) {
    const ImuBias bias = simulate_imu(still.first_seconds(0), adis16448(), seed).biases.front();
    gyro2 += bias.gyro.squaredNorm() / (3 * kSeeds);
    accel2 += bias.accel.squaredNorm() / (3 * kSeeds);
  }
  EXPECT_NEAR(std::sqrt(gyro2), 0.02, 0.002);
  EXPECT_NEAR(std::sqrt(accel2), 0.1, 0.01);
}

}  // namespace
}  // namespace covey
