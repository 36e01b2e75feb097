// SPDX-License-Identifier: Apache-2.0
//
// Fusing two estimates of one point whose correlation nobody knows (Julier and Uhlmann, ACC 1997).
#pragma once

#include <Eigen/Core>

namespace covey {

struct PointEstimate {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();
};

struct IntersectedPoint {
  PointEstimate fused;
  double weight = 1;  // of the first estimate's information; 1: the second adds nothing
};

// inv(C) = w inv(A) + (1 - w) inv(B), with the w in [0, 1] of the smallest trace.
[[nodiscard]] IntersectedPoint intersect_covariances(const PointEstimate& a,
                                                     const PointEstimate& b);

}  // namespace covey
