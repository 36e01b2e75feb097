// SPDX-License-Identifier: Apache-2.0
#include "estimator/so3.h"

#include <gtest/gtest.h>

#include <random>

namespace covey {
namespace {

Eigen::Vector3d drawn(std::mt19937& random, double sigma) {
  std::normal_distribution<double> normal(0, sigma);
  return {normal(random), normal(random), normal(random)};
}

TEST(So3, LogarithmUndoesTheExponentialUpToHalfATurn) {
  std::mt19937 random(1);
  for (int i = 0; i < 200; ++i) {
    Eigen::Vector3d theta = drawn(random, i % 2 == 0 ? 1e-8 : 1.0);
    if (theta.norm() > M_PI) theta *= 3.1 / theta.norm();
    EXPECT_LT((log_quaternion(exp_quaternion(theta)) - theta).norm(), 1e-12 + 1e-9 * theta.norm());
  }
}

TEST(So3, RightJacobianIsTheDerivative) {
  constexpr double kStep = 1e-6;
  std::mt19937 random(2);
  for (int i = 0; i < 20; ++i) {
    const Eigen::Vector3d theta = drawn(random, i % 2 == 0 ? 1e-5 : 0.8);
    const Eigen::Matrix3d analytic = right_jacobian_so3(theta);
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(k);
      const Eigen::Vector3d numeric =
          (log_so3(exp_so3(theta).transpose() * exp_so3(theta + step)) -
           log_so3(exp_so3(theta).transpose() * exp_so3(theta - step))) /
          (2 * kStep);
      EXPECT_LT((analytic.col(k) - numeric).norm(), 1e-8);
    }
  }
}

// Against all of them, a hundredth of a degree apart.
TEST(So3, NoTurnAboutZIsNearerThanTheNearest) {
  std::mt19937 random(3);
  for (int i = 0; i < 5; ++i) {
    const Eigen::Matrix3d R = exp_so3(drawn(random, 1.0));
    const auto agreement = [&R](double yaw) {
      return (exp_so3({0, 0, yaw}).transpose() * R).trace();
    };
    const double nearest = agreement(nearest_yaw(R));
    for (double yaw = -M_PI; yaw < M_PI; yaw += 1e-4) ASSERT_LE(agreement(yaw), nearest + 1e-12);
  }
}

}  // namespace
}  // namespace covey
