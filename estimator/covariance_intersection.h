// SPDX-License-Identifier: Apache-2.0
//
// Fusing two estimates of one quantity whose correlation nobody knows (Julier and Uhlmann, ACC
// 1997).
#pragma once

#include <Eigen/Core>

namespace covey {

// The fused estimate is a + K (b - a), with covariance C.
struct Intersection {
  Eigen::Matrix4d K = Eigen::Matrix4d::Zero();
  Eigen::Matrix4d covariance = Eigen::Matrix4d::Identity();  // C
};

// inv(C) = w inv(A) + (1 - w) inv(B), with the w that makes tr(Q C) smallest. `Q`, positive
// semidefinite, says what the fusion is for, whatever the units of the components.
[[nodiscard]] Intersection intersect_covariances(const Eigen::Matrix4d& A, const Eigen::Matrix4d& B,
                                                 const Eigen::Matrix4d& Q);

}  // namespace covey
