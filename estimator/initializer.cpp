// SPDX-License-Identifier: Apache-2.0
#include "estimator/initializer.h"

#include <cmath>

#include "estimator/so3.h"

namespace covey {
namespace {

struct Statistics {
  Eigen::Vector3d mean_gyro = Eigen::Vector3d::Zero(), mean_accel = Eigen::Vector3d::Zero();
  double gyro_deviation = 0, accel_deviation = 0;
};

constexpr int kMinSamples = 20;  // in the window

Statistics statistics(std::vector<ImuSample>::const_iterator begin,
                      std::vector<ImuSample>::const_iterator end) {
  Statistics result;
  const auto count = static_cast<double>(end - begin);
  for (auto s = begin; s != end; ++s) {
    result.mean_gyro += s->gyro_imu / count;
    result.mean_accel += s->accel_imu / count;
  }
  double gyro = 0, accel = 0;
  for (auto s = begin; s != end; ++s) {
    gyro += (s->gyro_imu - result.mean_gyro).squaredNorm() / count;
    accel += (s->accel_imu - result.mean_accel).squaredNorm() / count;
  }
  result.gyro_deviation = std::sqrt(gyro);
  result.accel_deviation = std::sqrt(accel);
  return result;
}

}  // namespace

double heading_of(const Eigen::Quaterniond& q_world_imu) {
  const Eigen::Matrix3d R = q_world_imu.toRotationMatrix();
  const int ahead = R.block<2, 1>(0, 0).squaredNorm() < 0.5 ? 2 : 0;
  return std::atan2(R(1, ahead), R(0, ahead));
}

double yaw_between(const Eigen::Quaterniond& from_world_imu,
                   const Eigen::Quaterniond& to_world_imu) {
  return nearest_yaw((to_world_imu * from_world_imu.conjugate()).toRotationMatrix());
}

Eigen::Quaterniond turned_about_z(double yaw, const Eigen::Quaterniond& q_world_imu) {
  const Eigen::Quaterniond turn(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()));
  return (turn * q_world_imu).normalized();
}

std::variant<InitialState, NotStill> static_initialization(const std::vector<ImuSample>& samples,
                                                           const Eigen::Vector3d& p_world_imu,
                                                           double heading,
                                                           const StaticInitConfig& config) {
  if (samples.size() < 2 ||
      seconds_between(samples.front().stamp_ns, samples.back().stamp_ns) < config.window_s) {
    return NotStill{"not enough IMU samples yet"};
  }
  const TimeNs begin_ns = samples.back().stamp_ns - nanoseconds(config.window_s);
  auto begin = samples.begin();
  while (begin->stamp_ns < begin_ns) ++begin;
  if (samples.end() - begin < kMinSamples) return NotStill{"not enough IMU samples yet"};
  const Statistics window = statistics(begin, samples.end());
  if (window.gyro_deviation > config.max_gyro_deviation ||
      window.mean_gyro.norm() > config.max_gyro_bias) {
    return NotStill{"rotating"};
  }
  if (window.accel_deviation > config.max_accel_deviation ||
      std::abs(window.mean_accel.norm() - config.gravity) > config.max_gravity_error) {
    return NotStill{"accelerating"};
  }
  // Smallest rotation that turns the measured up to the world's up, then the asked-for heading.
  const Eigen::Quaterniond level =
      Eigen::Quaterniond::FromTwoVectors(window.mean_accel, Eigen::Vector3d::UnitZ());
  InitialState start;
  start.stamp_ns = samples.back().stamp_ns;
  start.pose.p_world_imu = p_world_imu;
  start.pose.q_world_imu = turned_about_z(heading - heading_of(level), level);
  start.gyro_bias = window.mean_gyro;
  start.gyro_bias_sigma = 0.005;
  start.tilt_sigma = 0.02;  // an accelerometer bias of 0.1 m/s2 tilts the horizon by 0.01 rad
  start.accel_bias_sigma = 0.1;
  start.velocity_sigma = 0.02;
  return start;
}

}  // namespace covey
