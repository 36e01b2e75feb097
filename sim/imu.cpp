// SPDX-License-Identifier: Apache-2.0
#include "sim/imu.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "sim/random.h"

namespace covey {

// The sensor.yaml of the EuRoC dataset (Burri et al., 2016), whose IMU this is.
ImuSensor adis16448() {
  ImuSensor sensor;
  sensor.noise.gyro_density = 1.6968e-4;
  sensor.noise.gyro_random_walk = 1.9393e-5;
  sensor.noise.accel_density = 2.0e-3;
  sensor.noise.accel_random_walk = 3.0e-3;
  return sensor;
}

// InvenSense, ICM-20608-G datasheet, DS-000081 revision 1.0 (2015): rate noise 0.008
// deg/s/sqrt(Hz), accelerometer noise 250 ug/sqrt(Hz). It states no random walks: those of the
// ADIS16448 are used.
ImuSensor icm20608() {
  ImuSensor sensor = adis16448();
  sensor.noise.gyro_density = 0.008 * M_PI / 180;
  sensor.noise.accel_density = 250e-6 * 9.80665;
  return sensor;
}

const ImuBias& ImuRecording::bias_at(TimeNs stamp_ns) const {
  assert(!biases.empty() && biases.size() == samples.size());
  const auto after = std::upper_bound(
      samples.begin(), samples.end(), stamp_ns,
      [](TimeNs stamp, const ImuSample& sample) { return stamp < sample.stamp_ns; });
  const auto index = std::max<std::ptrdiff_t>(0, after - samples.begin() - 1);
  return biases[static_cast<std::size_t>(index)];
}

ImuRecording simulate_imu(const Trajectory& trajectory, const ImuSensor& sensor, std::uint64_t seed,
                          TimeNs start_ns) {
  // Discretisation: a sample averages white noise over one interval, a bias walks for one interval.
  const double root_rate = std::sqrt(sensor.rate_hz);
  const Eigen::Vector3d gravity_world(0, 0, -sensor.gravity);
  Random random(seed, 0x1517);
  ImuBias bias;
  bias.gyro = sensor.gyro_start_bias_sigma * random.gaussian_vector();
  bias.accel = sensor.accel_start_bias_sigma * random.gaussian_vector();

  ImuRecording recording;
  const auto count =
      static_cast<std::size_t>(std::floor(trajectory.duration_s() * sensor.rate_hz + 1e-6)) + 1;
  recording.samples.reserve(count);
  recording.biases.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const KinematicState state = trajectory.at(static_cast<double>(i) / sensor.rate_hz);
    const Eigen::Vector3d force_imu =
        state.pose.q_world_imu.conjugate() * (state.a_world_imu - gravity_world);
    ImuSample sample;
    sample.stamp_ns = start_ns + nanoseconds(static_cast<double>(i) / sensor.rate_hz);
    sample.gyro_imu = state.omega_imu + bias.gyro +
                      sensor.noise.gyro_density * root_rate * random.gaussian_vector();
    sample.accel_imu =
        force_imu + bias.accel + sensor.noise.accel_density * root_rate * random.gaussian_vector();
    recording.samples.push_back(sample);
    recording.biases.push_back(bias);
    bias.gyro += sensor.noise.gyro_random_walk / root_rate * random.gaussian_vector();
    bias.accel += sensor.noise.accel_random_walk / root_rate * random.gaussian_vector();
  }
  return recording;
}

}  // namespace covey
