// SPDX-License-Identifier: Apache-2.0
#include "estimator/relative_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>

#include "estimator/so3.h"

namespace covey {
namespace {

using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kIterations = 10;
constexpr double kConverged = 1e-6;  // m and rad
constexpr double kOutlier = 9.21;    // chi-square, 2 degrees of freedom, 99 %

// One match seen by a hypothesis: residual, its covariance, and how it changes with [dp dtheta].
struct Row {
  bool in_front = false;
  Eigen::Vector2d r = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity();
  Matrix26d J = Matrix26d::Zero();
};

// q = R^T (a - rho p), the landmark in the own camera times rho: points far away need no care.
Row linearize(const Eigen::Isometry3d& T_other_own, const LandmarkMatch& match, double sigma) {
  Row row;
  const Eigen::Matrix3d Rt = T_other_own.linear().transpose();
  const Eigen::Vector3d& p = T_other_own.translation();
  const Eigen::Vector3d turned = match.other_bearing.homogeneous() - match.inverse_depth * p;
  const Eigen::Vector3d q = Rt * turned;
  row.in_front = q.z() > 1e-3;
  if (!row.in_front) return row;
  Eigen::Matrix<double, 2, 3> J_q;
  J_q << 1, 0, -q.x() / q.z(), 0, 1, -q.y() / q.z();
  J_q /= q.z();
  const Eigen::Matrix<double, 2, 3> J_turned = J_q * Rt;
  row.r = match.bearing - q.hnormalized();
  row.J << -match.inverse_depth * J_turned, J_turned * skew(turned);
  const Eigen::Vector2d by_depth = J_turned * p * match.inverse_depth_sigma;
  row.covariance = sigma * sigma * Eigen::Matrix2d::Identity() + by_depth * by_depth.transpose();
  return row;
}

struct Normal {
  Matrix6d A = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  int inliers = 0;
};

// Standard deviation of the scale of the other drone's map. How its depths hang together nobody
// says, but what they have in common is in each of them: at most what the best known one has.
double common_scale_sigma(const KeyframeMatch& match) {
  double least = 1;
  for (const LandmarkMatch& landmark : match.matches) {
    if (!(landmark.inverse_depth > 0)) continue;
    least = std::min(least, landmark.inverse_depth_sigma / landmark.inverse_depth);
  }
  return least;
}

// Outliers keep a pull that no longer grows with their distance (Cauchy); inliers are counted.
Normal accumulate(const KeyframeMatch& match, const Eigen::Isometry3d& T_other_own) {
  Normal normal;
  for (const LandmarkMatch& landmark : match.matches) {
    const Row row = linearize(T_other_own, landmark, match.bearing_sigma);
    if (!row.in_front) continue;
    const Eigen::Matrix2d W = row.covariance.inverse();
    const double distance = row.r.dot(W * row.r);
    const double weight = 1 / (1 + distance / kOutlier);
    normal.A += weight * row.J.transpose() * W * row.J;
    normal.b += weight * row.J.transpose() * W * row.r;
    normal.inliers += distance < kOutlier ? 1 : 0;
  }
  return normal;
}

}  // namespace

std::optional<RelativePose> estimate_relative_pose(const KeyframeMatch& match, int min_inliers) {
  Eigen::Isometry3d T = match.T_other_own;
  Normal normal;
  for (int i = 0; i < kIterations; ++i) {
    normal = accumulate(match, T);
    if (normal.inliers < min_inliers) return std::nullopt;
    const Vector6d step = normal.A.ldlt().solve(normal.b);
    if (!step.allFinite()) return std::nullopt;
    T.translation() += step.head<3>();
    T.linear() = exp_so3(step.tail<3>()) * T.linear();
    if (step.cwiseAbs().maxCoeff() < kConverged) break;
  }
  const Eigen::LLT<Matrix6d> cholesky(normal.A);
  if (cholesky.info() != Eigen::Success || cholesky.rcond() < 1e-12) return std::nullopt;
  RelativePose pose{match.drone, match.own, match.other, T, {}, normal.inliers};
  pose.covariance = cholesky.solve(Matrix6d::Identity());
  // A map that is too large puts the own camera too far away.
  const Eigen::Vector3d by_scale = common_scale_sigma(match) * T.translation();
  pose.covariance.topLeftCorner<3, 3>() += by_scale * by_scale.transpose();
  return pose;
}

}  // namespace covey
