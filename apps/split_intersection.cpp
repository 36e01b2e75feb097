// SPDX-License-Identifier: Apache-2.0
#include "apps/split_intersection.h"

#include <Eigen/Cholesky>
#include <limits>

#include "estimator/chi_square.h"
#include "estimator/so3.h"

namespace covey {
namespace {

constexpr double kGateConfidence = 0.999;

Vector6d residual(const RelativePose& measurement, const Eigen::Matrix3d& R_other,
                  const Eigen::Vector3d& b) {
  Vector6d r;
  r << R_other * measurement.T_other_own.translation() - b,
      log_so3(R_other * measurement.T_other_own.linear() *
              measurement.own.T_world_cam.linear().transpose());
  return r;
}

// Of the relative pose, in world: what bearings leave open, and the scale of the depths, which is
// as wrong as the other's odometry was over the way on which they were measured.
Matrix6d noise(const RelativePose& measurement, const Eigen::Matrix3d& R_other,
               const Eigen::Vector3d& b) {
  constexpr double kShortest_m = 0.3;  // depths measured over less come from somewhere else
  const KeyframePose &other = measurement.other, &before = measurement.other_before;
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = R_other;
  Matrix6d R = turn * measurement.covariance * turn.transpose();
  const Eigen::Vector3d p = other.T_world_cam.translation(),
                        way = p - before.T_world_cam.translation();
  if (way.norm() < kShortest_m) return R;
  const Matrix6d Q =
      drift_step(before.T_world_cam.translation(), before.covariance, p, other.covariance).Q;
  const Eigen::Vector3d gradient = way / way.squaredNorm();
  R.topLeftCorner<3, 3>() += gradient.dot(Q.topLeftCorner<3, 3>() * gradient) * (b * b.transpose());
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
  const Eigen::Matrix3d R_other = measurement.other.T_world_cam.linear();
  const Eigen::Vector3d b =
      measurement.own.T_world_cam.translation() - measurement.other.T_world_cam.translation();
  Matrix6d H = Matrix6d::Identity();  // of the other one's error
  H.topRightCorner<3, 3>() = -skew(b);
  const Matrix6d theirs = H * other.covariance * H.transpose();
  const Matrix6d R = noise(measurement, R_other, b);
  const Vector6d r = residual(measurement, R_other, b) - drift_.mean + H * other.mean;
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
