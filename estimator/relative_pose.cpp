// SPDX-License-Identifier: Apache-2.0
#include "estimator/relative_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <vector>

#include "estimator/so3.h"

namespace covey {
namespace {

using Matrix26d = Eigen::Matrix<double, 2, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;

constexpr int kIterations = 15;
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

struct Sightings {
  const std::vector<LandmarkMatch>& landmarks;
  double sigma;  // of the own bearings
};

Sightings best_of(const KeyframeMatch& match, int min_inliers) {
  if (match.aligned.size() >= static_cast<std::size_t>(min_inliers)) {
    return {match.aligned, match.aligned_sigma};
  }
  return {match.matches, match.bearing_sigma};
}

struct Normal {
  Matrix6d A = Matrix6d::Zero();
  Vector6d b = Vector6d::Zero();
  int inliers = 0;
};

// Beyond `outlier` a match keeps a pull that no longer grows with its distance (Cauchy); inliers
// are counted.
Normal accumulate(const Sightings& sightings, const Eigen::Isometry3d& T_other_own,
                  double outlier) {
  Normal normal;
  for (const LandmarkMatch& landmark : sightings.landmarks) {
    const Row row = linearize(T_other_own, landmark, sightings.sigma);
    if (!row.in_front) continue;
    const Eigen::Matrix2d W = row.covariance.inverse();
    const double distance = row.r.dot(W * row.r);
    const double weight = 1 / (1 + distance / outlier);
    normal.A += weight * row.J.transpose() * W * row.J;
    normal.b += weight * row.J.transpose() * W * row.r;
    normal.inliers += distance < kOutlier ? 1 : 0;
  }
  return normal;
}

// From afar all matches are heard; who disagrees is left out as the pose gets better.
std::optional<Normal> solve(const Sightings& sightings, Eigen::Isometry3d& T) {
  constexpr double kWidest = 1024, kNarrower = 0.25;
  double widened = kWidest;
  Normal normal;
  for (int i = 0; i < kIterations; ++i) {
    widened = std::max(1.0, kNarrower * widened);
    normal = accumulate(sightings, T, widened * kOutlier);
    const Vector6d step = normal.A.ldlt().solve(normal.b);
    if (!step.allFinite()) return std::nullopt;
    T.translation() += step.head<3>();
    T.linear() = exp_so3(step.tail<3>()) * T.linear();
    if (widened == 1.0 && step.cwiseAbs().maxCoeff() < kConverged) break;
  }
  return normal;
}

}  // namespace

std::optional<RelativePose> estimate_relative_pose(const KeyframeMatch& match, int min_inliers) {
  Eigen::Isometry3d T = match.T_other_own;
  const std::optional<Normal> normal = solve(best_of(match, min_inliers), T);
  if (!normal || normal->inliers < min_inliers) return std::nullopt;
  const Eigen::LLT<Matrix6d> cholesky(normal->A);
  if (cholesky.info() != Eigen::Success || cholesky.rcond() < 1e-12) return std::nullopt;
  RelativePose pose{match.drone, match.own, match.other,    match.other_before,
                    T,           {},        normal->inliers};
  pose.covariance = cholesky.solve(Matrix6d::Identity());
  return pose;
}

}  // namespace covey
