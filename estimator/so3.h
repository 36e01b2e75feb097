// SPDX-License-Identifier: Apache-2.0
//
// Rotations: exponential map, logarithm, skew matrix and the right Jacobian of SO(3).
// Conventions as in Sola et al., "A micro Lie theory for state estimation in robotics" (2018).
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace covey {

[[nodiscard]] inline Eigen::Matrix3d skew(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0, -v.z(), v.y(), v.z(), 0, -v.x(), -v.y(), v.x(), 0;
  return m;
}

[[nodiscard]] inline Eigen::Quaterniond exp_quaternion(const Eigen::Vector3d& theta) {
  const double angle = theta.norm();
  const double half_sinc = angle < 1e-6 ? 0.5 - angle * angle / 48 : std::sin(angle / 2) / angle;
  return {std::cos(angle / 2), half_sinc * theta.x(), half_sinc * theta.y(), half_sinc * theta.z()};
}

[[nodiscard]] inline Eigen::Vector3d log_quaternion(const Eigen::Quaterniond& q) {
  const double sign = q.w() < 0 ? -1.0 : 1.0;
  const double sine = q.vec().norm();
  const double half_angle = std::atan2(sine, sign * q.w());
  const double scale = sine < 1e-9 ? 2.0 : 2 * half_angle / sine;
  return sign * scale * q.vec();
}

[[nodiscard]] inline Eigen::Matrix3d exp_so3(const Eigen::Vector3d& theta) {
  return exp_quaternion(theta).toRotationMatrix();
}

[[nodiscard]] inline Eigen::Vector3d log_so3(const Eigen::Matrix3d& R) {
  return log_quaternion(Eigen::Quaterniond(R));
}

// Of the rotation about z that is nearest to R, rad: it maximises trace(Rz(yaw)^T R).
[[nodiscard]] inline double nearest_yaw(const Eigen::Matrix3d& R) {
  return std::atan2(R(1, 0) - R(0, 1), R(0, 0) + R(1, 1));
}

// Exp(theta + d) = Exp(theta) Exp(Jr(theta) d) to first order (Sola 2018, eq. 143).
[[nodiscard]] inline Eigen::Matrix3d right_jacobian_so3(const Eigen::Vector3d& theta) {
  const double a2 = theta.squaredNorm();
  const double a = std::sqrt(a2);
  const double b = a < 1e-4 ? 0.5 - a2 / 24 : (1 - std::cos(a)) / a2;
  const double c = a < 1e-4 ? 1.0 / 6 - a2 / 120 : (a - std::sin(a)) / (a2 * a);
  const Eigen::Matrix3d K = skew(theta);
  return Eigen::Matrix3d::Identity() - b * K + c * K * K;
}

}  // namespace covey
