// SPDX-License-Identifier: Apache-2.0
#include "estimator/bearing.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

TEST(Bearing, DerivativeByThePointAgreesWithDifferencesAtAnyDepth) {
  for (const Eigen::Vector3d& p_cam :
       {Eigen::Vector3d(0.3, -0.2, 1), Eigen::Vector3d(-0.8, 2.4, 4), Eigen::Vector3d(0, 0, 0.5)}) {
    const Eigen::Vector2d bearing = p_cam.hnormalized();
    const auto by_point = [&](const Eigen::Vector3d& d) -> Eigen::Vector2d {
      return (p_cam + d).hnormalized();
    };
    expect_jacobian("J_point", bearing_by_point_at_depth_1(bearing) / p_cam.z(), by_point);
  }
}

}  // namespace
}  // namespace covey
