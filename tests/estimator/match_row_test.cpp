// SPDX-License-Identifier: Apache-2.0
#include "estimator/match_row.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>

#include "estimator/so3.h"
#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

constexpr double kLogRatio = 0.07;

Eigen::Isometry3d pose() {
  Eigen::Isometry3d T_other_own = Eigen::Isometry3d::Identity();
  T_other_own.linear() = exp_so3({0.2, -0.4, 0.1});
  T_other_own.translation() << 0.8, -0.3, 1.1;
  return T_other_own;
}

LandmarkMatch match() {
  LandmarkMatch match;
  match.bearing = {0.1, 0.25};
  match.other_bearing = {0.3, -0.2};
  match.inverse_depth = 0.2;
  match.inverse_depth_sigma = 0.01;
  match.own_inverse_depth = 0.3;
  match.own_inverse_depth_sigma = 0.02;
  match.bearing_covariance << 4e-6, 1e-6, 1e-6, 2e-6;
  return match;
}

// What is expected, and so minus the residual.
Eigen::VectorXd expected(const Eigen::Isometry3d& T_other_own, double log_ratio,
                         const LandmarkMatch& match) {
  return -match_row(T_other_own, log_ratio, match).r;
}

TEST(MatchRow, JacobianIsThatOfWhatIsExpected) {
  const auto moved = [](const Eigen::VectorXd& error) {
    Eigen::Isometry3d T_other_own = pose();
    T_other_own.translation() += error.head<3>();
    T_other_own.linear() = exp_so3(error.segment<3>(3)) * T_other_own.linear();
    return expected(T_other_own, kLogRatio + error(6), match());
  };
  expect_jacobian("match_row", match_row(pose(), kLogRatio, match()).J, moved);
}

TEST(MatchRow, CovarianceIsThatOfTheBearingAndOfBothDepths) {
  const auto by_depth = [](const Eigen::VectorXd& error) {
    LandmarkMatch off = match();
    off.inverse_depth += error(0);
    return expected(pose(), kLogRatio, off);
  };
  const LandmarkMatch seen = match();
  const Eigen::Vector3d J = numeric_jacobian(by_depth, 1) * seen.inverse_depth_sigma;
  Eigen::Matrix3d covariance = J * J.transpose();
  covariance.topLeftCorner<2, 2>() += seen.bearing_covariance;
  covariance(2, 2) += std::pow(seen.own_inverse_depth_sigma, 2);
  EXPECT_TRUE(match_row(pose(), kLogRatio, seen).covariance.isApprox(covariance, 1e-6));
}

TEST(MatchRow, WithoutAnOwnDepthNothingIsSaidOfTheRatio) {
  LandmarkMatch unknown = match();
  unknown.own_inverse_depth = unknown.own_inverse_depth_sigma = 0;
  const MatchRow row = match_row(pose(), kLogRatio, unknown);
  EXPECT_EQ(row.r.z(), 0);
  EXPECT_TRUE(row.J.row(2).isZero());
  EXPECT_TRUE(row.J.topRows<2>().isApprox(match_row(pose(), kLogRatio, match()).J.topRows<2>()));
}

TEST(MatchRow, APointBehindTheCameraIsToldApart) {
  LandmarkMatch behind = match();
  behind.inverse_depth = 5;
  EXPECT_FALSE(match_row(pose(), kLogRatio, behind).in_front);
}

}  // namespace
}  // namespace covey
