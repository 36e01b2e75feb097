// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_observation.h"

#include "estimator/drift_step.h"
#include "estimator/so3.h"

namespace covey {

Matrix7d noise_of(const RelativePose& measurement, const DepthRatio* ratio,
                  const Eigen::Matrix3d& R) {
  Matrix7d noise = Matrix7d::Identity();
  noise.topLeftCorner<6, 6>() = rotated(measurement.covariance, R);
  if (ratio == nullptr) return noise;
  noise.block<3, 1>(0, 6) = R * ratio->covariance_with_pose.head<3>();
  noise.block<3, 1>(3, 6) = R * ratio->covariance_with_pose.tail<3>();
  noise.bottomLeftCorner<1, 6>() = noise.topRightCorner<6, 1>().transpose();
  noise(6, 6) = ratio->variance;
  return noise;
}

// r = e_own - e_other + [b]x dtheta_other - b s + n, b from other to own, and of the depths
// s_own - s_other + n. s = g (dp - dp_before): the share by which odometry has a way too short, of
// that side whose depths were used; in n is also by how much depths are wrong otherwise.
DriftObservation observe_drift(const ObservedKeyframe& own, const ObservedKeyframe& other,
                               const RelativePose& measurement, const DepthRatio* ratio) {
  const bool by_own_depths = measurement.found_by_other;
  const ObservedKeyframe& used = by_own_depths ? own : other;  // whose depths were
  const Eigen::Vector3d b = own.p - other.p;
  DriftObservation result;
  result.r.head<6>() = relative_residual(measurement.T_other_own, other.R, own.R, b);
  result.H_own.setIdentity();
  result.H_other = -Matrix76d::Identity();
  result.H_other.block<3, 3>(0, 3) = skew(b);
  (by_own_depths ? result.H_own : result.H_other).topLeftCorner<3, 3>() -= b * used.scale;
  (by_own_depths ? result.H_own_before : result.H_other_before).topLeftCorner<3, 3>() =
      b * used.scale;
  result.noise = noise_of(measurement, ratio, other.R);
  Vector7d by_used = Vector7d::Zero();
  by_used.head<3>() = -b;
  if (ratio != nullptr) {
    result.H_own.bottomLeftCorner<1, 3>() = own.scale;
    result.H_own_before.bottomLeftCorner<1, 3>() = -own.scale;
    result.H_other.bottomLeftCorner<1, 3>() = -other.scale;
    result.H_other_before.bottomLeftCorner<1, 3>() = other.scale;
    result.r(6) = ratio->log_ratio;
    by_used(6) = by_own_depths ? 1 : -1;
    result.noise(6, 6) += by_own_depths ? other.unshared : own.unshared;
  }
  result.noise += used.unshared * by_used * by_used.transpose();
  return result;
}

}  // namespace covey
