// SPDX-License-Identifier: Apache-2.0
#include "apps/split_intersection.h"

#include <Eigen/Cholesky>

#include "estimator/chi_square.h"
#include "estimator/so3.h"

namespace covey {
namespace {

constexpr double kGateConfidence = 0.999;

// Of the relative pose, in world: what bearings leave open, and the scale of the depths, which is
// as wrong as the other's odometry was over the way on which they were measured.
Matrix6d noise(const RelativePose& measurement, const Eigen::Vector3d& b) {
  const KeyframePose &other = measurement.other, &before = measurement.other_before;
  const Eigen::Vector3d p = other.T_world_cam.translation(),
                        p_before = before.T_world_cam.translation();
  const Matrix6d Q = drift_step(p_before, before.covariance, p, other.covariance).Q;
  const Eigen::Matrix3d by_scale = b * scale_gradient(p_before, p);
  Matrix6d R = rotated(measurement.covariance, other.T_world_cam.linear());
  R.topLeftCorner<3, 3>() += by_scale * Q.topLeftCorner<3, 3>() * by_scale.transpose();
  return R;
}

struct Fused {
  Matrix6d K = Matrix6d::Zero();
  Matrix6d covariance = Matrix6d::Identity();
};

// With weight w of what is known here, P / w, and 1 - w of the other one, so that the determinant
// is smallest.
Fused intersect(const Matrix6d& P, const Matrix6d& other, const Matrix6d& R) {
  constexpr int kSteps = 50;
  Fused best{Matrix6d::Zero(), P};
  double smallest = P.determinant();
  for (int i = 1; i < kSteps; ++i) {
    const double w = static_cast<double>(i) / kSteps;
    const Matrix6d own = P / w;
    const Matrix6d S = own + other / (1 - w) + R;
    const Matrix6d K = S.llt().solve(own).transpose();
    const Matrix6d covariance = own - K * S * K.transpose();
    const double determinant = covariance.determinant();
    if (determinant >= smallest) continue;
    smallest = determinant;
    best = {K, (covariance + covariance.transpose()) / 2};
  }
  return best;
}

}  // namespace

void SplitIntersection::add_own(const KeyframePose& pose) {
  if (newest_) {
    const DriftStep step = drift_step(newest_->T_world_cam.translation(), newest_->covariance,
                                      pose.T_world_cam.translation(), pose.covariance);
    drift_.mean = step.A * drift_.mean;
    drift_.covariance = step.A * drift_.covariance * step.A.transpose() + step.Q;
  } else {
    drift_.covariance = pose.covariance;
  }
  newest_ = pose;
  past_[pose.keyframe_id] = drift_;
}

std::optional<DriftEstimate> SplitIntersection::at(std::uint64_t keyframe_id) const {
  const auto known = past_.find(keyframe_id);
  if (known == past_.end()) return std::nullopt;
  return known->second;
}

// r = e_own - e_other + [b]x dtheta_other + n, b from other to own.
bool SplitIntersection::fuse(const RelativePose& measurement, const DriftEstimate& other) {
  const Eigen::Vector3d b =
      measurement.own.T_world_cam.translation() - measurement.other.T_world_cam.translation();
  Matrix6d H = Matrix6d::Identity();  // of the other one's error
  H.topRightCorner<3, 3>() = -skew(b);
  const Matrix6d theirs = H * other.covariance * H.transpose();
  const Matrix6d R = noise(measurement, b);
  const Vector6d r =
      relative_residual(measurement.T_other_own, measurement.other.T_world_cam.linear(),
                        measurement.own.T_world_cam.linear(), b) -
      drift_.mean + H * other.mean;
  const Matrix6d S = drift_.covariance + theirs + R;
  if (r.dot(S.llt().solve(r)) > chi_square_quantile(kGateConfidence, 6)) return false;
  const Fused fused = intersect(drift_.covariance, theirs, R);
  if (fused.K.isZero()) return false;
  drift_.mean += fused.K * r;
  drift_.covariance = fused.covariance;
  past_[newest_->keyframe_id] = drift_;
  return true;
}

Odometry SplitIntersection::corrected(const Odometry& alone) const {
  if (!newest_) return alone;
  return without_drift(alone, newest_->T_world_cam.translation(), newest_->covariance, drift_.mean,
                       drift_.covariance);
}

}  // namespace covey
