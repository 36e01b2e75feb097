// SPDX-License-Identifier: Apache-2.0
#include "estimator/match_row.h"

#include <cmath>

#include "estimator/bearing.h"
#include "estimator/so3.h"

namespace covey {

// q = R^T (a - rho p), the landmark in the own camera times rho: points far away need no care. The
// own inverse depth is rho / q_z times the ratio.
MatchRow match_row(const Eigen::Isometry3d& T_other_own, double log_ratio,
                   const LandmarkMatch& match) {
  MatchRow row;
  const Eigen::Matrix3d Rt = T_other_own.linear().transpose();
  const Eigen::Vector3d& p = T_other_own.translation();
  const double rho = match.inverse_depth;
  const Eigen::Vector3d turned = match.other_bearing.homogeneous() - rho * p;
  const Eigen::Vector3d q = Rt * turned;
  row.in_front = q.z() > 1e-3;
  if (!row.in_front) return row;
  Eigen::Matrix3d J_q = Eigen::Matrix3d::Zero();
  J_q.topRows<2>() = bearing_by_point_at_depth_1(q.hnormalized()) / q.z();
  row.covariance.topLeftCorner<2, 2>() = match.bearing_covariance;
  Eigen::Vector3d J_rho = Eigen::Vector3d::Zero();  // but for what q changes with it
  row.r.head<2>() = match.bearing - q.hnormalized();
  if (match.own_inverse_depth > 0) {
    const double expected = rho / q.z() * std::exp(log_ratio);
    row.r.z() = match.own_inverse_depth - expected;
    J_q(2, 2) = -expected / q.z();
    J_rho.z() = expected / rho;
    row.J(2, 6) = expected;
    row.covariance(2, 2) = match.own_inverse_depth_sigma * match.own_inverse_depth_sigma;
  }
  const Eigen::Matrix3d J_turned = J_q * Rt;
  row.J.leftCols<3>() = -rho * J_turned;
  row.J.middleCols<3>(3) = J_turned * skew(turned);
  const Eigen::Vector3d by_depth = (J_rho - J_turned * p) * match.inverse_depth_sigma;
  row.covariance += by_depth * by_depth.transpose();
  return row;
}

}  // namespace covey
