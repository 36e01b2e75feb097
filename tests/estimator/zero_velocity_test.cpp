// SPDX-License-Identifier: Apache-2.0
#include "estimator/zero_velocity.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "estimator/so3.h"

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

bool update(State& state, const std::vector<ImuSample>& interval) {
  EkfUpdate rows(16, state.capacity());
  return update_zero_velocity(state, rows, interval, config());
}

TEST(ZeroVelocity, ReadingsThatAreNoNumbersAreGated) {
  State state = still_state();
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  EXPECT_FALSE(update(state, readings(state, {std::nan(""), 0, 0}, none)));
  EXPECT_TRUE(state.imu().gyro_bias.allFinite());
}

}  // namespace
}  // namespace covey
