// SPDX-License-Identifier: Apache-2.0
#include "estimator/state_readout.h"

#include <cassert>

#include "estimator/observation_model.h"
#include "estimator/so3.h"

namespace covey {

Odometry odometry_of(const CoreState& core) {
  const ImuState& imu = core.imu;
  const auto of = [&core](int row, int column) { return core.covariance.block<3, 3>(row, column); };
  constexpr int kPosition = State::kPosition, kVelocity = State::kVelocity;
  constexpr int kRotation = State::kRotation;
  Odometry odometry;
  odometry.stamp_ns = imu.stamp_ns;
  odometry.pose = imu.pose;
  odometry.v_world_imu = imu.v_world_imu;
  odometry.gyro_bias = imu.gyro_bias;
  odometry.accel_bias = imu.accel_bias;
  odometry.pose_covariance << of(kPosition, kPosition), of(kPosition, kRotation),
      of(kRotation, kPosition), of(kRotation, kRotation);
  odometry.velocity_covariance = of(kVelocity, kVelocity);
  return odometry;
}

CameraEstimate camera_of(const State& state) {
  assert(!state.clones().empty());
  const CameraExtrinsics& extrinsics = state.extrinsics();
  const Pose& imu = state.clones().back().pose;
  const CameraPose camera = camera_pose(imu, extrinsics);
  const Eigen::Matrix3d R = imu.q_world_imu.toRotationMatrix();
  const Eigen::Matrix3d zero = Eigen::Matrix3d::Zero();
  Matrix6d by_imu, by_extrinsics;
  by_imu << Eigen::Matrix3d::Identity(), -R * skew(extrinsics.p_imu_cam), zero, R;
  by_extrinsics << R, zero, zero, camera.R_world_cam;

  const int clone = state.clone_offset(static_cast<int>(state.clones().size()) - 1);
  const Eigen::MatrixXd P = state.metric_covariance(clone + 6);
  Matrix6d covariance = by_imu * P.block<6, 6>(clone, clone) * by_imu.transpose();
  if (const int at = state.extrinsics_offset(); at >= 0) {
    const Matrix6d cross = by_extrinsics * P.block<6, 6>(at, clone) * by_imu.transpose();
    covariance += cross + cross.transpose() +
                  by_extrinsics * P.block<6, 6>(at, at) * by_extrinsics.transpose();
  }
  CameraEstimate estimate;
  estimate.T_world_cam.linear() = camera.R_world_cam;
  estimate.T_world_cam.translation() = camera.p_world_cam;
  estimate.covariance = (covariance + covariance.transpose()) / 2;
  return estimate;
}

CalibrationSigma calibration_sigma_of(const State& state) {
  CalibrationSigma sigma;
  const Eigen::VectorXd sigmas = state.covariance().diagonal().cwiseSqrt();
  if (const int at = state.extrinsics_offset(); at >= 0) {
    sigma.p_imu_cam = sigmas.segment<3>(at);
    sigma.theta_imu_cam = sigmas.segment<3>(at + 3);
  }
  if (const int at = state.time_offset_offset(); at >= 0) sigma.time_offset_s = sigmas[at];
  if (const int at = state.intrinsics_offset(); at >= 0)
    sigma.intrinsics = sigmas.segment<kIntrinsicsSize>(at);
  return sigma;
}

}  // namespace covey
