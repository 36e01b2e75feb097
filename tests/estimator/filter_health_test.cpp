// SPDX-License-Identifier: Apache-2.0
#include "estimator/filter_health.h"

#include <gtest/gtest.h>

#include <vector>

namespace covey {
namespace {

constexpr std::size_t kMany = 50;  // tracks
constexpr bool kSeeing = true;

State state_at(double time_s, const Eigen::Vector3d& v_world_imu = Eigen::Vector3d::Zero()) {
  ImuState imu;
  imu.stamp_ns = nanoseconds(time_s);
  imu.v_world_imu = v_world_imu;
  return State({}, imu, 1e-4 * Eigen::Matrix<double, 15, 15>::Identity());
}

UpdateReport fitting(int used, int gated) {
  UpdateReport report;
  report.slam_used = used;
  report.slam_gated = gated;
  return report;
}

// Every tenth of a second, from a healthy start to `until_s`.
Remedy watched(FilterHealth& health, double until_s, const UpdateReport& report, std::size_t tracks,
               bool seeing) {
  health.begin(state_at(0));
  Remedy remedy = Remedy::kNone;
  for (double t = 0.1; t <= until_s && remedy == Remedy::kNone; t += 0.1) {
    remedy = health.watch(state_at(t), report, tracks, seeing, {}, {});
  }
  return remedy;
}

TEST(FilterHealth, WhatFitsKeepsItHealthy) {
  FilterHealth health;
  EXPECT_EQ(watched(health, 10, fitting(5, 5), kMany, kSeeing), Remedy::kNone);
  EXPECT_EQ(health.status(), FilterStatus::kTracking);
  EXPECT_GT(health.healthy_ns(), nanoseconds(9.8));
}

TEST(FilterHealth, SaysAfterHalfASecondThatNothingFits) {
  FilterHealth health;
  EXPECT_EQ(watched(health, 0.45, fitting(0, 0), 0, kSeeing), Remedy::kNone);
  EXPECT_EQ(health.status(), FilterStatus::kTracking);
  EXPECT_EQ(watched(health, 10, fitting(0, 0), 0, kSeeing), Remedy::kNone) << "it is only dark";
  EXPECT_EQ(health.status(), FilterStatus::kDegraded);
}

TEST(FilterHealth, MostlyContradictedForSecondsItRestarts) {
  FilterHealth health;
  EXPECT_EQ(watched(health, 1.9, fitting(1, 9), kMany, kSeeing), Remedy::kNone);
  EXPECT_EQ(watched(health, 2.3, fitting(1, 9), kMany, kSeeing), Remedy::kRestart);
  EXPECT_EQ(health.healthy_ns(), 0) << "where it goes back to";
  health.restarted();
  EXPECT_EQ(health.status(), FilterStatus::kLost);
}

TEST(FilterHealth, TracksOfWhichNoneIsAcceptedAreLookedAtAnew) {
  FilterHealth health;
  EXPECT_EQ(watched(health, 2.2, fitting(0, 0), kMany, kSeeing), Remedy::kLookAgain);
  EXPECT_EQ(watched(health, 2.2, fitting(0, 0), kMany, !kSeeing), Remedy::kNone);
}

TEST(FilterHealth, AnImpossibleMotionRestartsAtOnce) {
  FilterHealth health;
  health.begin(state_at(0));
  EXPECT_EQ(health.watch(state_at(0.1, {100, 0, 0}), fitting(9, 0), kMany, kSeeing, {}, {}),
            Remedy::kRestart);
}

TEST(FilterHealth, GoesBackToTheHealthyStateCarriedOnByTheImu) {
  FilterHealth health;
  health.begin(state_at(0, {1, 0, 0}));
  std::vector<ImuSample> level;
  for (int i = 0; i <= 100; ++i) level.push_back({nanoseconds(i / 100.0), {0, 0, 0}, {0, 0, 9.81}});
  health.pass(nanoseconds(1), {level}, {});
  EXPECT_NEAR(health.fallback({}).imu.pose.p_world_imu.x(), 1, 1e-9);
  EXPECT_EQ(health.status(), FilterStatus::kDegraded);
  EXPECT_EQ(health.healthy_ns(), 0);
}

// As of a drone that has waited in the dark, and whose IMU has gone on telling of acceleration.
TEST(FilterHealth, WhereTheImuLeadsToAnImpossibleVelocityNothingOfItIsKnown) {
  const EstimatorConfig config;
  FilterHealth health;
  health.begin(state_at(0, {config.max_velocity - 1, 0, 0}));
  std::vector<ImuSample> faster;
  for (int i = 0; i <= 100; ++i) {
    faster.push_back({nanoseconds(i / 100.0), {0, 0, 0}, {2, 0, 9.81}});
  }
  health.pass(nanoseconds(1), {faster}, config);
  const CoreState core = health.fallback(config);
  EXPECT_TRUE(core.imu.v_world_imu.isZero(0));
  EXPECT_EQ(core.covariance(State::kVelocity, State::kVelocity), 100);
  EXPECT_EQ(core.covariance(State::kVelocity, State::kPosition), 0);
  EXPECT_EQ(core.covariance(State::kPosition, State::kVelocity), 0);
  EXPECT_NEAR(core.imu.pose.p_world_imu.x(), config.max_velocity, 1e-6) << "that is kept";
}

// What has not been seen for long is no contradiction.
TEST(FilterHealth, AfterTheDarkContradictionHasToLastAsWell) {
  FilterHealth health;
  health.begin(state_at(0));
  std::vector<ImuSample> still;
  for (int i = 0; i <= 250; ++i) still.push_back({nanoseconds(i / 100.0), {0, 0, 0}, {0, 0, 9.81}});
  health.pass(nanoseconds(2.5), {still}, {});
  Remedy remedy = Remedy::kNone;
  double t = 2.6;
  for (; t < 6 && remedy == Remedy::kNone; t += 0.1) {
    remedy = health.watch(state_at(t), fitting(1, 9), kMany, kSeeing, {}, {});
  }
  EXPECT_EQ(remedy, Remedy::kRestart);
  EXPECT_NEAR(t, 2.6 + EstimatorConfig().lost_after_s + 0.2, 0.15);
}

}  // namespace
}  // namespace covey
