// SPDX-License-Identifier: Apache-2.0
#include "estimator/zero_velocity.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

#include "estimator/so3.h"
#include "tests/estimator/moved_imu.h"
#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

EstimatorConfig config() { return {}; }

State still_state(const Eigen::Vector3d& v_world_imu = Eigen::Vector3d::Zero()) {
  ImuState imu;
  imu.pose.q_world_imu = exp_quaternion({0.1, -0.2, 0.7});
  imu.v_world_imu = v_world_imu;
  imu.gyro_bias = {0.01, -0.02, 0.03};
  imu.accel_bias = {0.05, 0.02, -0.04};
  return State(config(), imu, 1e-4 * Eigen::Matrix<double, 15, 15>::Identity());
}

// What an IMU reads that stands still in this state, and beyond that.
std::vector<ImuSample> readings(const State& state, const Eigen::Vector3d& more_gyro,
                                const Eigen::Vector3d& more_accel) {
  const ImuState& imu = state.imu();
  const Eigen::Vector3d up_imu =
      imu.pose.q_world_imu.conjugate() * Eigen::Vector3d(0, 0, config().gravity);
  std::vector<ImuSample> samples;
  for (int i = 0; i < 8; ++i) {
    samples.push_back(
        {nanoseconds(0.005 * i), imu.gyro_bias + more_gyro, up_imu + imu.accel_bias + more_accel});
  }
  return samples;
}

bool update(State& state, const std::vector<ImuSample>& interval, const Stillness& still = {}) {
  EkfUpdate rows(16, state.capacity());
  return update_zero_velocity(state, rows, interval, still, config());
}

// The residual is measurement minus expectation.
TEST(ZeroVelocity, TheJacobianAgreesWithDifferences) {
  const State state = still_state({0.1, -0.05, 0.02});
  const auto interval = readings(state, {0.01, 0.02, -0.01}, {0.1, -0.2, 0.3});
  expect_jacobian("still rows", -still_rows(state.imu(), interval, 0.1, config()).H,
                  [&](const Eigen::VectorXd& dx) -> Eigen::VectorXd {
                    return still_rows(moved(state.imu(), dx), interval, 0.1, config()).r;
                  });
}

TEST(ZeroVelocity, StandingStillStopsTheDrone) {
  State state = still_state({0.01, -0.01, 0.01});
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  EXPECT_TRUE(update(state, readings(state, none, none)));
  EXPECT_LT(state.imu().v_world_imu.norm(), 0.9 * 0.01 * std::sqrt(3));
  EXPECT_LT(state.covariance()(State::kVelocity, State::kVelocity), 0.9 * 1e-4);
}

double sigma(const State& state, int offset) {
  return std::sqrt(state.covariance().diagonal().segment<3>(offset).mean());
}

// An hour of it: a glide is not stopped by what is said of it ever again.
TEST(ZeroVelocity, WhatIsNotSeenCountsOnce) {
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const auto after_an_hour = [&](const Stillness& still) {
    State state = still_state({0.01, -0.01, 0.01});
    for (int image = 0; image < 1000; ++image) {
      EXPECT_TRUE(update(state, readings(state, none, none), still));
    }
    return state;
  };
  const Stillness stands{true, 0}, glides{false, 0.005};
  EXPECT_LT(sigma(after_an_hour(stands), State::kVelocity), 0.001);
  EXPECT_LT(sigma(after_an_hour(stands), State::kAccelBias), 0.01);
  EXPECT_NEAR(sigma(after_an_hour(glides), State::kVelocity), 0.005, 0.0005);
  EXPECT_EQ(sigma(after_an_hour(glides), State::kAccelBias),
            sigma(still_state(), State::kAccelBias));
}

TEST(ZeroVelocity, WhatContradictsTheStateChangesNothing) {
  State state = still_state({0.5, 0, 0});
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const Eigen::MatrixXd before = state.covariance();
  EXPECT_FALSE(update(state, readings(state, none, none)));
  EXPECT_EQ(state.imu().v_world_imu, Eigen::Vector3d(0.5, 0, 0));
  EXPECT_EQ(Eigen::MatrixXd(state.covariance()), before);
}

TEST(ZeroVelocity, ReadingsThatAreNoNumbersAreGated) {
  State state = still_state();
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  EXPECT_FALSE(update(state, readings(state, {std::nan(""), 0, 0}, none)));
  EXPECT_TRUE(state.imu().gyro_bias.allFinite());
}

// A grid of points, seen through a second of images in which they move by `motion` altogether, each
// in a direction of its own: no rotation explains that.
StillnessDetector watched(double motion, const TrackList& like) {
  StillnessDetector detector;
  for (int image = 0; image <= 10; ++image) {
    TrackList tracks = like;
    for (TrackObservation& track : tracks) {
      const double direction = 2.4 * static_cast<double>(track.track_id);
      track.bearing +=
          motion * image / 10 * Eigen::Vector2d(std::cos(direction), std::sin(direction));
    }
    detector.add_image(nanoseconds(0.1 * image), tracks, config());
  }
  return detector;
}

TrackList grid(double sigma) {
  TrackList tracks;
  for (int i = 0; i < 49; ++i) {
    tracks.push_back({static_cast<std::uint64_t>(i) + 1,
                      {0.1 * (i % 7 - 3), 0.1 * (i / 7 - 3)},
                      sigma * sigma * Eigen::Matrix2d::Identity()});
  }
  return tracks;
}

TEST(StillnessDetector, TellsStandingFromMoving) {
  EXPECT_TRUE(watched(0, grid(1e-4)).speed_if_still(config()));
  EXPECT_TRUE(watched(0.001, grid(1e-4)).speed_if_still(config())) << "0.0004 in a window";
  EXPECT_FALSE(watched(0.01, grid(1e-4)).speed_if_still(config()));
  EXPECT_TRUE(watched(0.01, grid(1e-2)).speed_if_still(config())) << "may be noise";
}

TEST(StillnessDetector, NeedsAWindowOfImagesWithTracks) {
  StillnessDetector detector;
  EXPECT_FALSE(detector.speed_if_still(config()));
  for (const double time_s : {0.0, 0.1, 0.2}) {
    detector.add_image(nanoseconds(time_s), grid(1e-4), config());
  }
  EXPECT_FALSE(detector.speed_if_still(config())) << "too short";
  EXPECT_FALSE(watched(0, {}).speed_if_still(config())) << "nothing to be seen";
}

// Above level ground, so high that a small step sideways looks like a turn.
TEST(StillnessDetector, FlyingSidewaysAboveLevelGroundIsNotHovering) {
  constexpr double kHeight_m = 6.5;
  const auto at = [&](double x_m) {
    TrackList tracks = grid(1e-4);
    for (TrackObservation& track : tracks) track.bearing.x() -= x_m / kHeight_m;
    return tracks;
  };
  StillnessDetector flies, hovers;
  for (int image = 0; image < 60; ++image) {
    const double time_s = image / 30.0;
    flies.add_image(nanoseconds(time_s), at(0.02 * time_s), config());
    hovers.add_image(nanoseconds(time_s), at(0.005 * std::sin(5 * time_s)), config());
  }
  EXPECT_FALSE(flies.speed_if_still(config()));
  EXPECT_TRUE(hovers.speed_if_still(config()));
  EstimatorConfig anywhere = config();
  anywhere.still_drift = 1;
  EXPECT_TRUE(flies.speed_if_still(anywhere)) << "which is what this is about";
}

// The first of the tracks is much less sure than all others.
TEST(StillnessDetector, OneTrackDoesNotSpeakForTheNoiseOfAll) {
  TrackList tracks = grid(1e-4);
  tracks.front().covariance *= 1e4;
  EXPECT_FALSE(watched(0.01, tracks).speed_if_still(config()));
}

}  // namespace
}  // namespace covey
