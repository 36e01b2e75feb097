// SPDX-License-Identifier: Apache-2.0
#include "estimator/imu_increment.h"

#include <algorithm>
#include <cassert>

#include "estimator/so3.h"

namespace covey {
namespace {

// One step between neighbouring samples, bias removed: mean rate, specific force at both ends.
struct Step {
  double dt_s;
  double span_s;                // between the measured samples around it
  Eigen::Vector3d rate;         // rad/s
  Eigen::Vector3d force_start;  // m/s2
  Eigen::Vector3d force_end;    // m/s2
};

double square(double x) { return x * x; }

// In a gap rate and specific force are Brownian bridges, whose integral over all of it has a
// variance of wander^2 span^3 / 12: as white noise of that density, per second.
double in_gap(double wander, const Step& step, const ImuNoise& noise) {
  return step.span_s > noise.max_gap_s ? square(wander * step.span_s) / 12 : 0;
}

// The error of [position velocity rotation] carried over one step, and what white noise adds to it.
void propagate_covariance(ImuIncrement& sum, const Step& step, const Eigen::Matrix3d& R_start,
                          const Eigen::Matrix3d& R_step, const ImuNoise& noise) {
  using Matrix9d = Eigen::Matrix<double, 9, 9>;
  const double dt = step.dt_s;
  const Eigen::Matrix3d force_skew = R_start * skew((step.force_start + step.force_end) / 2);
  Matrix9d F = Matrix9d::Identity();
  F.block<3, 3>(0, 3) = dt * Eigen::Matrix3d::Identity();
  F.block<3, 3>(0, 6) = -0.5 * dt * dt * force_skew;
  F.block<3, 3>(3, 6) = -dt * force_skew;
  F.block<3, 3>(6, 6) = R_step.transpose();
  sum.covariance = F * sum.covariance * F.transpose();

  const double accel = square(noise.accel_density) + in_gap(noise.accel_wander, step, noise);
  const double gyro = square(noise.gyro_density) + in_gap(noise.gyro_wander, step, noise);
  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
  sum.covariance.block<3, 3>(0, 0) += accel * dt * dt * dt / 3 * I;
  sum.covariance.block<3, 3>(0, 3) += accel * dt * dt / 2 * I;
  sum.covariance.block<3, 3>(3, 0) += accel * dt * dt / 2 * I;
  sum.covariance.block<3, 3>(3, 3) += accel * dt * I;
  sum.covariance.block<3, 3>(6, 6) += gyro * dt * I;
}

void add_step(ImuIncrement& sum, const Step& step, const ImuNoise& noise) {
  const double dt = step.dt_s;
  const Eigen::Vector3d angle = step.rate * dt;
  const Eigen::Matrix3d R_start = sum.rotation.toRotationMatrix();
  const Eigen::Matrix3d R_step = exp_so3(angle);
  const Eigen::Matrix3d R_end = R_start * R_step;
  propagate_covariance(sum, step, R_start, R_step, noise);

  // Derivatives of the rotated forces at both ends by the gyro bias.
  const Eigen::Matrix3d J_rotation_end =
      R_step.transpose() * sum.J_rotation_gyro_bias - right_jacobian_so3(angle) * dt;
  const Eigen::Matrix3d J_start = -R_start * skew(step.force_start) * sum.J_rotation_gyro_bias;
  const Eigen::Matrix3d J_end = -R_end * skew(step.force_end) * J_rotation_end;
  const double dt2 = dt * dt;
  sum.J_position_gyro_bias += dt * sum.J_velocity_gyro_bias + dt2 * (J_start / 3 + J_end / 6);
  sum.J_velocity_gyro_bias += dt / 2 * (J_start + J_end);
  sum.J_position_accel_bias += dt * sum.J_velocity_accel_bias - dt2 * (R_start / 3 + R_end / 6);
  sum.J_velocity_accel_bias -= dt / 2 * (R_start + R_end);
  sum.J_rotation_gyro_bias = J_rotation_end;

  // Specific force linear in time over the step: trapezoid for velocity, 1/3 and 1/6 for position.
  const Eigen::Vector3d a_start = R_start * step.force_start;
  const Eigen::Vector3d a_end = R_end * step.force_end;
  sum.position += dt * sum.velocity + dt2 * (a_start / 3 + a_end / 6);
  sum.velocity += dt / 2 * (a_start + a_end);
  sum.rotation = (sum.rotation * exp_quaternion(angle)).normalized();
  sum.duration_s += dt;
}

}  // namespace

ImuIncrement integrate_imu(const ImuInterval& interval, const Eigen::Vector3d& gyro_bias,
                           const Eigen::Vector3d& accel_bias, const ImuNoise& noise) {
  const std::vector<ImuSample>& samples = interval.samples;
  assert(samples.size() >= 2);
  ImuIncrement sum;
  for (std::size_t i = 1; i < samples.size(); ++i) {
    const ImuSample& start = samples[i - 1];
    const ImuSample& end = samples[i];
    const double dt = seconds_between(start.stamp_ns, end.stamp_ns);
    if (dt <= 0) continue;
    double span = dt;
    if (i == 1) span = std::max(span, interval.first_span_s);
    if (i + 1 == samples.size()) span = std::max(span, interval.last_span_s);
    add_step(sum,
             {dt, span, (start.gyro_imu + end.gyro_imu) / 2 - gyro_bias,
              start.accel_imu - accel_bias, end.accel_imu - accel_bias},
             noise);
  }
  return sum;
}

ImuSample interpolate(const ImuSample& before, const ImuSample& after, TimeNs stamp_ns) {
  const double span = seconds_between(before.stamp_ns, after.stamp_ns);
  const double share = span > 0 ? seconds_between(before.stamp_ns, stamp_ns) / span : 0.0;
  return {stamp_ns, before.gyro_imu + share * (after.gyro_imu - before.gyro_imu),
          before.accel_imu + share * (after.accel_imu - before.accel_imu)};
}

}  // namespace covey
