// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_step.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "estimator/so3.h"

namespace covey {

Matrix6d drift_lever(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  Matrix6d F = Matrix6d::Identity();
  F.block<3, 1>(0, 5) = Eigen::Vector3d::UnitZ().cross(to - from);
  return F;
}

// Odometry says how uncertain it was at both ends, not how the two errors hang together. Where it
// has become less certain (position, yaw), the old error has stayed and something was added:
// cov(to, from) = P_from. Where it has become more certain (tilt), the new error is what is left of
// the old one: cov(to, from) = P_to. With V V^T = F P_from F^T and V L V^T = P_to both are
// V min(1, L) V^T.
DriftStep drift_step(const Eigen::Vector3d& from, const Matrix6d& P_from, const Eigen::Vector3d& to,
                     const Matrix6d& P_to) {
  constexpr double kMinVariance = 1e-10;  // m2 or rad2
  const Matrix6d F = drift_lever(from, to);
  const Eigen::LLT<Matrix6d> cholesky(F * P_from * F.transpose());
  const auto L = cholesky.matrixL();
  const Matrix6d M = L.solve(L.solve(P_to).transpose());
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen((M + M.transpose()) / 2);
  const Vector6d kept = eigen.eigenvalues().cwiseMax(0.0).cwiseMin(1.0);
  const Vector6d added = eigen.eigenvalues().cwiseMax(0.0) - kept.cwiseAbs2();
  const Matrix6d V = L * eigen.eigenvectors();
  const Matrix6d V_inverse = eigen.eigenvectors().transpose() * L.solve(Matrix6d::Identity());
  DriftStep step{V * kept.asDiagonal() * V_inverse * F, V * added.asDiagonal() * V.transpose()};
  step.Q.diagonal().array() += kMinVariance;
  return step;
}

bool is_depth_baseline(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  constexpr double kShortest = 0.3;  // m; depths measured over less come from somewhere else
  return (to - from).norm() >= kShortest;
}

Eigen::RowVector3d scale_gradient(const Eigen::Vector3d& from, const Eigen::Vector3d& to) {
  if (!is_depth_baseline(from, to)) return Eigen::RowVector3d::Zero();
  const Eigen::Vector3d way = to - from;
  return way.transpose() / way.squaredNorm();
}

Matrix6d rotated(const Matrix6d& covariance, const Eigen::Matrix3d& R) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = R;
  turn.bottomRightCorner<3, 3>() = R;
  return turn * covariance * turn.transpose();
}

Vector6d relative_residual(const Eigen::Isometry3d& T_other_own,
                           const Eigen::Matrix3d& R_world_other, const Eigen::Matrix3d& R_world_own,
                           const Eigen::Vector3d& b) {
  Vector6d r;
  r.head<3>() = R_world_other * T_other_own.translation() - b;
  r.tail<3>() = log_so3(R_world_other * T_other_own.linear() * R_world_own.transpose());
  return r;
}

Odometry without_drift(const Odometry& alone, const Eigen::Vector3d& from, const Matrix6d& P_from,
                       const Vector6d& drift, const Matrix6d& P_drift) {
  Matrix6d to_world = Matrix6d::Identity();  // from [dp dtheta_local]
  to_world.bottomRightCorner<3, 3>() = alone.pose.q_world_imu.toRotationMatrix();
  const DriftStep step = drift_step(from, P_from, alone.pose.p_world_imu,
                                    to_world * alone.pose_covariance * to_world.transpose());
  const Vector6d error = step.A * drift;
  const Matrix6d P = step.A * P_drift * step.A.transpose() + step.Q;

  Odometry odometry = alone;
  const Eigen::Quaterniond turn = exp_quaternion(error.tail<3>());
  odometry.pose.p_world_imu += error.head<3>();
  odometry.pose.q_world_imu = (turn * alone.pose.q_world_imu).normalized();
  odometry.v_world_imu = turn * alone.v_world_imu;
  const Eigen::Matrix3d R_turn = turn.toRotationMatrix();
  odometry.velocity_covariance = R_turn * alone.velocity_covariance * R_turn.transpose();
  to_world.bottomRightCorner<3, 3>() = odometry.pose.q_world_imu.toRotationMatrix();
  odometry.pose_covariance = to_world.transpose() * P * to_world;
  return odometry;
}

}  // namespace covey
