// SPDX-License-Identifier: Apache-2.0
//
// The algebra below the filter: gates, null space, compression, covariance intersection, IMU sums.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <random>

#include "estimator/chi_square.h"
#include "estimator/covariance_intersection.h"
#include "estimator/ekf_update.h"
#include "estimator/imu_increment.h"
#include "estimator/initializer.h"
#include "estimator/so3.h"

namespace covey {
namespace {

Eigen::MatrixXd random_matrix(int rows, int columns, unsigned seed) {
  std::mt19937 generator(seed);
  std::normal_distribution<double> normal;
  return Eigen::MatrixXd::NullaryExpr(rows, columns, [&] { return normal(generator); });
}

Eigen::Matrix4d random_covariance(unsigned seed) {
  const Eigen::Matrix4d A = random_matrix(4, 4, seed);
  return A * A.transpose() + 0.1 * Eigen::Matrix4d::Identity();
}

TEST(ChiSquare, QuantilesAreThoseOfTheTables) {
  EXPECT_NEAR(chi_square_quantile(0.95, 1), 3.841, 1e-3);
  EXPECT_NEAR(chi_square_quantile(0.95, 2), 5.991, 1e-3);
  EXPECT_NEAR(chi_square_quantile(0.95, 3), 7.815, 1e-3);
  EXPECT_NEAR(chi_square_quantile(0.99, 21), 38.932, 1e-3);
}

TEST(EkfUpdate, ProjectingOutAFeatureLeavesRowsWithoutIt) {
  const Eigen::MatrixXd H_f_before = random_matrix(12, 3, 1);
  const Eigen::MatrixXd H_before = random_matrix(12, 8, 2);
  Eigen::Matrix<double, Eigen::Dynamic, 3> H_f = H_f_before;
  Eigen::MatrixXd H = H_before;
  project_out_feature(H_f, H);
  EXPECT_LT(H_f.bottomRows(9).norm(), 1e-12);
  EXPECT_LT((H.transpose() * H - H_before.transpose() * H_before).norm(), 1e-10);
}

TEST(EkfUpdate, CompressionKeepsAllInformation) {
  Eigen::MatrixXd rows = random_matrix(50, 7, 3);
  const Eigen::MatrixXd H = rows.leftCols(6);
  const Eigen::VectorXd r = rows.col(6);
  ASSERT_EQ(compress_rows(rows), 6);
  const Eigen::MatrixXd small = rows.topLeftCorner(6, 6);
  EXPECT_LT((small.transpose() * small - H.transpose() * H).norm(), 1e-10);
  EXPECT_LT((small.transpose() * rows.col(6).head(6) - H.transpose() * r).norm(), 1e-10);
}

TEST(CovarianceIntersection, NeverClaimsLessThanTheTruthWhateverTheCorrelation) {
  const Eigen::Matrix4d I = Eigen::Matrix4d::Identity();
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Eigen::Matrix4d A = random_covariance(seed), B = random_covariance(seed + 1000);
    const Intersection fused = intersect_covariances(A, B, I);
    // The worst case that stays a covariance: both errors are the same draw, scaled.
    const Eigen::Matrix4d L_a = A.llt().matrixL(), L_b = B.llt().matrixL();
    const Eigen::Matrix4d together = (I - fused.K) * L_a + fused.K * L_b;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> slack(fused.covariance -
                                                               together * together.transpose());
    EXPECT_GT(slack.eigenvalues().minCoeff(), -1e-9) << "seed " << seed;
  }
}

TEST(CovarianceIntersection, NoOtherWeightIsBetter) {
  const Eigen::Matrix4d Q = Eigen::Vector4d(1, 4, 0.5, 2).asDiagonal();
  for (unsigned seed = 0; seed < 50; ++seed) {
    const Eigen::Matrix4d A = random_covariance(seed), B = random_covariance(seed + 1000);
    const double best = (Q * intersect_covariances(A, B, Q).covariance).trace();
    for (double w = 0.01; w < 1; w += 0.01) {
      const Eigen::Matrix4d C = (w * A.inverse() + (1 - w) * B.inverse()).inverse();
      EXPECT_LE(best, (Q * C).trace() * (1 + 1e-6)) << "seed " << seed << ", weight " << w;
    }
  }
}

TEST(CovarianceIntersection, TheSameEstimateTwiceAddsNothing) {
  const Eigen::Matrix4d A = random_covariance(7);
  const Intersection fused = intersect_covariances(A, A, Eigen::Matrix4d::Identity());
  EXPECT_LT((fused.covariance - A).norm(), 1e-9);
}

std::vector<ImuSample> wobble() {
  std::vector<ImuSample> samples;
  for (int i = 0; i <= 20; ++i) {
    const double t = 0.005 * i;
    samples.push_back({nanoseconds(t),
                       {0.5 + t, -0.3 + 2 * t, std::sin(9 * t)},
                       {0.2 - t, std::cos(7 * t), 9.6 + 3 * t}});
  }
  return samples;
}

TEST(ImuIncrement, BiasDerivativesAgreeWithDifferences) {
  const std::vector<ImuSample> samples = wobble();
  const Eigen::Vector3d bg(0.01, -0.02, 0.03), ba(0.1, 0.05, -0.07);
  const ImuNoise noise;
  const ImuIncrement at = integrate_imu({samples}, bg, ba, noise);
  constexpr double kStep = 1e-5;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
    const ImuIncrement up = integrate_imu({samples}, bg + step, ba, noise);
    const ImuIncrement down = integrate_imu({samples}, bg - step, ba, noise);
    const Eigen::Vector3d turned = (log_quaternion(at.rotation.conjugate() * up.rotation) -
                                    log_quaternion(at.rotation.conjugate() * down.rotation)) /
                                   (2 * kStep);
    EXPECT_LT((at.J_rotation_gyro_bias.col(i) - turned).norm(), 1e-6);
    EXPECT_LT((at.J_velocity_gyro_bias.col(i) - (up.velocity - down.velocity) / (2 * kStep)).norm(),
              1e-5);
    EXPECT_LT((at.J_position_gyro_bias.col(i) - (up.position - down.position) / (2 * kStep)).norm(),
              1e-6);
    const ImuIncrement faster = integrate_imu({samples}, bg, ba + step, noise);
    EXPECT_LT((at.J_velocity_accel_bias.col(i) - (faster.velocity - at.velocity) / kStep).norm(),
              1e-7);
    EXPECT_LT((at.J_position_accel_bias.col(i) - (faster.position - at.position) / kStep).norm(),
              1e-7);
  }
}

TEST(StaticInitialization, FindsGravityAndGyroBias) {
  const Eigen::Quaterniond q = exp_quaternion({0.1, -0.2, 0.7});
  const Eigen::Vector3d up_imu = q.conjugate() * Eigen::Vector3d(0, 0, 9.81);
  std::vector<ImuSample> samples;
  for (int i = 0; i <= 200; ++i) {
    samples.push_back({nanoseconds(0.005 * i), {0.01, -0.02, 0.03}, up_imu});
  }
  const auto result = static_initialization(samples, {1, 2, 3}, heading_of(q), {});
  const auto* start = std::get_if<InitialState>(&result);
  ASSERT_NE(start, nullptr);
  EXPECT_LT(start->pose.q_world_imu.angularDistance(q), 1e-9);
  EXPECT_LT((start->gyro_bias - Eigen::Vector3d(0.01, -0.02, 0.03)).norm(), 1e-12);
}

// Whichever way the IMU is mounted: its x axis ahead, upside down, up as EuRoC's, or down.
TEST(StaticInitialization, AnAccelerometersBiasHardlyTurnsTheHeading) {
  Eigen::Matrix3d ahead, below, up, down;
  ahead << 1, 0, 0, 0, 1, 0, 0, 0, 1;
  below << 1, 0, 0, 0, -1, 0, 0, 0, -1;
  up << 0, 0, 1, 0, -1, 0, 1, 0, 0;
  down << 0, 0, 1, 0, 1, 0, -1, 0, 0;
  constexpr double kHeading = 2.5, kTilt = 0.15 / 9.81;
  for (const Eigen::Matrix3d& mounted : {ahead, below, up, down}) {
    const Eigen::Quaterniond q = turned_about_z(kHeading, Eigen::Quaterniond(mounted));
    const Eigen::Vector3d up_imu = q.conjugate() * Eigen::Vector3d(0, 0, 9.81);
    EXPECT_NEAR(heading_of(q), kHeading, 1e-12);
    std::vector<ImuSample> samples;
    for (int i = 0; i <= 200; ++i) {
      samples.push_back(
          {nanoseconds(0.005 * i), {0, 0, 0}, up_imu + Eigen::Vector3d(0.1, -0.1, 0.05)});
    }
    const auto result = static_initialization(samples, {1, 2, 3}, kHeading, {});
    const auto* start = std::get_if<InitialState>(&result);
    ASSERT_NE(start, nullptr);
    EXPECT_LT(start->pose.q_world_imu.angularDistance(q), kTilt) << mounted;
    EXPECT_LT(std::abs(yaw_between(q, start->pose.q_world_imu)), kTilt * kTilt) << mounted;
  }
}

TEST(StaticInitialization, RefusesWhatMoves) {
  std::vector<ImuSample> samples;
  for (int i = 0; i <= 200; ++i) {
    samples.push_back({nanoseconds(0.005 * i), {0, 0, i % 2 == 0 ? 0.5 : -0.5}, {0, 0, 9.81}});
  }
  const auto result = static_initialization(samples, {0, 0, 0}, 0, {});
  ASSERT_TRUE(std::holds_alternative<NotStill>(result));
  EXPECT_EQ(std::get<NotStill>(result).reason, "rotating");
}

TEST(StaticInitialization, WhatAGapLeavesDoesNotShowThatItStandsStill) {
  std::vector<ImuSample> samples;
  for (int i = 0; i <= 200; ++i)
    samples.push_back({nanoseconds(0.005 * i), {0, 0, 0}, {0, 0, 9.81}});
  samples.push_back({nanoseconds(2.0), {0, 0, 0}, {0, 0, 9.81}});
  const auto result = static_initialization(samples, {0, 0, 0}, 0, {});
  EXPECT_TRUE(std::holds_alternative<NotStill>(result));
}

}  // namespace
}  // namespace covey
