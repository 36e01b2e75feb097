// SPDX-License-Identifier: Apache-2.0
#include "estimator/imu_transition.h"

#include "estimator/so3.h"

namespace covey {

ImuState carried_over(const ImuState& start, const ImuIncrement& increment, TimeNs end_ns,
                      const Eigen::Vector3d& g) {
  const double dt = increment.duration_s;
  const Eigen::Matrix3d R = start.pose.q_world_imu.toRotationMatrix();
  ImuState end = start;
  end.stamp_ns = end_ns;
  end.pose.p_world_imu += start.v_world_imu * dt + 0.5 * g * dt * dt + R * increment.position;
  end.v_world_imu += g * dt + R * increment.velocity;
  end.pose.q_world_imu = (start.pose.q_world_imu * increment.rotation).normalized();
  return end;
}

Matrix15d transition(const ImuIncrement& increment, const ImuState& first, const ImuState& end,
                     const Eigen::Vector3d& g) {
  const double dt = increment.duration_s;
  const Eigen::Matrix3d R = first.pose.q_world_imu.toRotationMatrix();
  const Eigen::Vector3d dv = end.v_world_imu - first.v_world_imu - g * dt;
  const Eigen::Vector3d dp =
      end.pose.p_world_imu - first.pose.p_world_imu - first.v_world_imu * dt - 0.5 * g * dt * dt;
  Matrix15d F;
  F.setIdentity();
  F.block<3, 3>(0, 3) = dt * Eigen::Matrix3d::Identity();
  F.block<3, 3>(0, 6) = -skew(dp) * R;
  F.block<3, 3>(0, 9) = R * increment.J_position_gyro_bias;
  F.block<3, 3>(0, 12) = R * increment.J_position_accel_bias;
  F.block<3, 3>(3, 6) = -skew(dv) * R;
  F.block<3, 3>(3, 9) = R * increment.J_velocity_gyro_bias;
  F.block<3, 3>(3, 12) = R * increment.J_velocity_accel_bias;
  F.block<3, 3>(6, 6) = end.pose.q_world_imu.toRotationMatrix().transpose() * R;
  F.block<3, 3>(6, 9) = increment.J_rotation_gyro_bias;
  return F;
}

Eigen::Matrix<double, State::kImuSize, 1> transition_by_scale(const Eigen::Vector3d& dv, double dt,
                                                              const Eigen::Vector3d& swing) {
  Eigen::Matrix<double, State::kImuSize, 1> F = Eigen::Matrix<double, State::kImuSize, 1>::Zero();
  F.segment<3>(State::kPosition) = -dt / 2 * dv - swing;
  F.segment<3>(State::kVelocity) = -dv;
  return F;
}

Matrix15d process_noise(const ImuIncrement& increment, const Eigen::Matrix3d& R,
                        const ImuNoise& noise) {
  Matrix15d Q;
  Q.setZero();
  Eigen::Matrix<double, 9, 9> G = Eigen::Matrix<double, 9, 9>::Identity();
  G.block<3, 3>(0, 0) = R;
  G.block<3, 3>(3, 3) = R;
  Q.topLeftCorner<9, 9>() = G * increment.covariance * G.transpose();
  const double dt = increment.duration_s;
  Q.block<3, 3>(9, 9).diagonal().setConstant(noise.gyro_random_walk * noise.gyro_random_walk * dt);
  Q.block<3, 3>(12, 12).diagonal().setConstant(noise.accel_random_walk * noise.accel_random_walk *
                                               dt);
  return Q;
}

CoreState dead_reckoned(const CoreState& start, const ImuInterval& interval,
                        const EstimatorConfig& config) {
  const Eigen::Vector3d g(0, 0, -config.gravity);
  const ImuIncrement increment =
      integrate_imu(interval, start.imu.gyro_bias, start.imu.accel_bias, config.imu_noise);
  CoreState end = start;
  end.imu = carried_over(start.imu, increment, interval.samples.back().stamp_ns, g);
  Eigen::MatrixXd F = Eigen::MatrixXd::Identity(start.covariance.rows(), start.covariance.cols());
  F.topLeftCorner<State::kImuSize, State::kImuSize>() =
      transition(increment, start.imu, end.imu, g);
  end.covariance = F * start.covariance * F.transpose();
  end.covariance.topLeftCorner<State::kImuSize, State::kImuSize>() +=
      process_noise(increment, start.imu.pose.q_world_imu.toRotationMatrix(), config.imu_noise);
  end.covariance = (end.covariance + end.covariance.transpose()).eval() / 2;
  return end;
}

}  // namespace covey
