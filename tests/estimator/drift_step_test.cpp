// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_step.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>

#include "estimator/so3.h"
#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

const Eigen::Vector3d kFrom(2, -1, 3), kTo(-4, 5, 1.5);

// Positions and attitudes after `from`, or of a peer's world about its pivot.
TEST(DriftStep, YawTurnsWhatComesAfterItAndTiltDoesNot) {
  const auto error_at_end = [](const Eigen::VectorXd& error) -> Eigen::VectorXd {
    const Eigen::AngleAxisd yaw(error(5), Eigen::Vector3d::UnitZ());
    Vector6d end = error;
    end.head<3>() = kFrom + error.head<3>() + yaw * (kTo - kFrom) - kTo;
    return end;
  };
  expect_jacobian("drift_lever", drift_lever(kFrom, kTo), error_at_end);
}

TEST(DriftStep, ScaleGradientIsThatOfTheShareByWhichTheWayIsTooShort) {
  const auto too_short = [](const Eigen::VectorXd& error) -> Eigen::VectorXd {
    const double odometry = (kTo - kFrom).norm();
    return Eigen::VectorXd::Constant(1, ((kTo + error) - kFrom).norm() / odometry - 1);
  };
  expect_jacobian("scale_gradient", scale_gradient(kFrom, kTo), too_short);
  EXPECT_TRUE(scale_gradient(kFrom, kFrom + 0.29 * Eigen::Vector3d::UnitX()).isZero());
}

}  // namespace
}  // namespace covey
