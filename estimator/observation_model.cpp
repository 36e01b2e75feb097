// SPDX-License-Identifier: Apache-2.0
#include "estimator/observation_model.h"

#include "estimator/so3.h"

namespace covey {
namespace {

constexpr double kMinDepth = 1e-3;  // m

// A world point in the camera frame, with derivatives.
struct CameraPoint {
  Eigen::Vector3d p_cam;
  Matrix36d J_pose, J_extrinsics;
  Eigen::Matrix3d J_point;
};

CameraPoint to_camera(const Eigen::Vector3d& p_world, const Pose& pose,
                      const CameraExtrinsics& extrinsics) {
  const Eigen::Matrix3d R_imu_world = pose.q_world_imu.toRotationMatrix().transpose();
  const Eigen::Matrix3d R_cam_imu = extrinsics.q_imu_cam.toRotationMatrix().transpose();
  const Eigen::Vector3d p_imu = R_imu_world * (p_world - pose.p_world_imu);
  CameraPoint point;
  point.p_cam = R_cam_imu * (p_imu - extrinsics.p_imu_cam);
  point.J_point = R_cam_imu * R_imu_world;
  point.J_pose << -point.J_point, R_cam_imu * skew(p_imu);
  point.J_extrinsics << -R_cam_imu, skew(point.p_cam);
  return point;
}

}  // namespace

PointObservation observe_point(const Eigen::Vector3d& p_world, const Pose& pose,
                               const CameraExtrinsics& extrinsics) {
  const CameraPoint point = to_camera(p_world, pose, extrinsics);
  PointObservation observation;
  const double z = point.p_cam.z();
  if (z < kMinDepth) return observation;
  observation.in_front = true;
  observation.bearing = point.p_cam.head<2>() / z;
  const Matrix23d J_cam = bearing_by_point_at_depth_1(observation.bearing) / z;
  observation.J_pose = J_cam * point.J_pose;
  observation.J_extrinsics = J_cam * point.J_extrinsics;
  observation.J_point = J_cam * point.J_point;
  return observation;
}

AnchoredPoint anchored_point(const Eigen::Vector3d& inverse_depth, const Pose& anchor,
                             const CameraExtrinsics& extrinsics) {
  const Eigen::Matrix3d R_world_imu = anchor.q_world_imu.toRotationMatrix();
  const Eigen::Matrix3d R_imu_cam = extrinsics.q_imu_cam.toRotationMatrix();
  const double depth = 1 / inverse_depth.z();
  const Eigen::Vector3d p_cam(inverse_depth.x() * depth, inverse_depth.y() * depth, depth);
  const Eigen::Vector3d p_imu = extrinsics.p_imu_cam + R_imu_cam * p_cam;
  Eigen::Matrix3d J_cam;  // d(p_cam)/d(alpha, beta, rho)
  J_cam << depth, 0, -p_cam.x() * depth, 0, depth, -p_cam.y() * depth, 0, 0, -depth * depth;

  AnchoredPoint point;
  point.p_world = anchor.p_world_imu + R_world_imu * p_imu;
  point.J_anchor << Eigen::Matrix3d::Identity(), -R_world_imu * skew(p_imu);
  point.J_extrinsics << R_world_imu, -R_world_imu * R_imu_cam * skew(p_cam);
  point.J_inverse_depth = R_world_imu * R_imu_cam * J_cam;
  return point;
}

InverseDepthOfPoint inverse_depth_of_point(const Eigen::Vector3d& p_world, const Pose& pose,
                                           const CameraExtrinsics& extrinsics) {
  const CameraPoint point = to_camera(p_world, pose, extrinsics);
  InverseDepthOfPoint result;
  const double z = point.p_cam.z();
  if (z < kMinDepth) return result;
  result.in_front = true;
  const double rho = 1 / z;
  const double alpha = point.p_cam.x() * rho;
  const double beta = point.p_cam.y() * rho;
  result.inverse_depth = {alpha, beta, rho};
  Eigen::Matrix3d J_cam;  // d(alpha, beta, rho)/d(p_cam)
  J_cam << rho * bearing_by_point_at_depth_1({alpha, beta}), 0, 0, -rho * rho;
  result.J_pose = J_cam * point.J_pose;
  result.J_extrinsics = J_cam * point.J_extrinsics;
  result.J_point = J_cam * point.J_point;
  return result;
}

BearingByIntrinsics pinhole_by_intrinsics(const Eigen::Vector2d& bearing) {
  const double x = bearing.x(), y = bearing.y(), r2 = bearing.squaredNorm();
  BearingByIntrinsics J;
  J << x, 0, 1, 0, r2 * x, r2 * r2 * x, 0, y, 0, 1, r2 * y, r2 * r2 * y;
  return J;
}

BearingByIntrinsics by_intrinsics_at(const Eigen::Vector2d& expected, const Eigen::Vector2d& at,
                                     const BearingByIntrinsics& by_intrinsics) {
  return by_intrinsics + pinhole_by_intrinsics(expected) - pinhole_by_intrinsics(at);
}

// The inverse of Cholesky's factor.
Eigen::Matrix2d whitening(const Eigen::Matrix2d& covariance) {
  const double l00 = std::sqrt(covariance(0, 0));
  const double l10 = covariance(1, 0) / l00;
  const double l11 = std::sqrt(covariance(1, 1) - l10 * l10);
  Eigen::Matrix2d W;
  W << 1 / l00, 0, -l10 / (l00 * l11), 1 / l11;
  return W;
}

CameraPose camera_pose(const Pose& pose, const CameraExtrinsics& extrinsics) {
  const Eigen::Matrix3d R_world_imu = pose.q_world_imu.toRotationMatrix();
  return {R_world_imu * extrinsics.q_imu_cam.toRotationMatrix(),
          pose.p_world_imu + R_world_imu * extrinsics.p_imu_cam};
}

std::optional<TrackDepth> depth_from(const State& state, const SlamLandmark& landmark,
                                     double relative_sigma) {
  const int anchor = state.find_clone(landmark.anchor_id);
  const Pose& anchor_pose = state.clones()[static_cast<std::size_t>(anchor)].pose;
  const Eigen::Vector3d p_world =
      anchored_point(landmark.inverse_depth, anchor_pose, state.extrinsics()).p_world;
  const auto now = inverse_depth_of_point(p_world, state.imu().pose, state.extrinsics());
  if (!now.in_front) return std::nullopt;
  const double inverse_depth = now.inverse_depth.z();
  return TrackDepth{landmark.track_id, inverse_depth, relative_sigma * inverse_depth};
}

}  // namespace covey
