// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_observation.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "estimator/drift_step.h"
#include "estimator/so3.h"
#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

Eigen::Isometry3d pose(const Eigen::Vector3d& turn, const Eigen::Vector3d& p) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = exp_so3(turn);
  T.translation() = p;
  return T;
}

// A keyframe and the one since which its drone measured depths.
struct Way {
  Eigen::Isometry3d before, at;
};

const Way kOwn{pose({0.4, 1.9, -1.1}, {3, -2, 1}), pose({-2.1, 0.7, 1.3}, {4.5, 1, 1.8})};
const Way kOther{pose({1.2, -0.3, 2.2}, {-6, 2, 4}), pose({0.5, 2.4, -0.8}, {-5, 6, 2.5})};
constexpr double kUnsharedOwn = 3e-4, kUnsharedOther = 5e-4;

ObservedKeyframe observed(const Way& way, double unshared) {
  return {way.at.translation(), way.at.linear(),
          scale_gradient(way.before.translation(), way.at.translation()), unshared};
}

Eigen::Isometry3d in_truth(const Eigen::Isometry3d& odometry, const Vector6d& error) {
  Eigen::Isometry3d T = odometry;
  T.translation() += error.head<3>();
  T.linear() = exp_so3(Eigen::Vector3d(error.tail<3>())) * odometry.linear();
  return T;
}

double length(const Way& way) { return (way.at.translation() - way.before.translation()).norm(); }

// [own own_before other other_before], [dp dtheta] each.
using Errors = Eigen::Matrix<double, 24, 1>;

// What is wrong with a measurement: [dp dtheta] in the other camera's axes and the log ratio, as in
// RelativePose; and by what share the own and the other's depths are too short beside what their
// ways are.
using Noise = Eigen::Matrix<double, 9, 1>;

// All that two drones measure whose odometry has kOwn and kOther.
RelativePose measure(const Errors& errors, const Noise& noise, bool by_own_depths) {
  const Way own{in_truth(kOwn.before, errors.segment<6>(6)),
                in_truth(kOwn.at, errors.segment<6>(0))};
  const Way other{in_truth(kOther.before, errors.segment<6>(18)),
                  in_truth(kOther.at, errors.segment<6>(12))};
  const double own_depths = length(kOwn) / length(own) * std::exp(-noise(7));
  const double other_depths = length(kOther) / length(other) * std::exp(-noise(8));
  RelativePose measured;
  measured.found_by_other = by_own_depths;
  measured.T_other_own = other.at.inverse() * own.at;
  measured.T_other_own.translation() *= by_own_depths ? own_depths : other_depths;
  measured.T_other_own = in_truth(measured.T_other_own, noise.head<6>());
  measured.depth_ratio.emplace().log_ratio = std::log(other_depths / own_depths) + noise(6);
  return measured;
}

// By how much that is not what odometry has: the other camera's axes turned into the world's.
Vector7d left_over(const RelativePose& measured) {
  const Eigen::Isometry3d expected = kOther.at.inverse() * kOwn.at;
  const Eigen::Matrix3d R = kOther.at.linear();
  Vector7d r;
  r << R * (measured.T_other_own.translation() - expected.translation()),
      R * log_so3(measured.T_other_own.linear() * expected.linear().transpose()),
      measured.depth_ratio->log_ratio;
  return r;
}

DriftObservation observe(const RelativePose& measured, bool with_ratio) {
  return observe_drift(observed(kOwn, kUnsharedOwn), observed(kOther, kUnsharedOther), measured,
                       with_ratio ? &*measured.depth_ratio : nullptr);
}

TEST(DriftObservation, WhatIsLeftOverIsTheDifferenceBetweenMeasurementAndOdometry) {
  const Errors errors = Errors::LinSpaced(-0.4, 0.5);
  const Noise noise = Noise::LinSpaced(0.1, -0.05);
  for (const bool by_own_depths : {false, true}) {
    const RelativePose measured = measure(errors, noise, by_own_depths);
    const Vector7d r = left_over(measured);
    EXPECT_LT((observe(measured, true).r - r).norm(), 1e-12);
    EXPECT_LT((observe(measured, false).r - r).head<6>().norm(), 1e-12);
    EXPECT_EQ(observe(measured, false).r(6), 0);
  }
}

TEST(DriftObservation, JacobiansOfPoseAndRatioAreThoseOfDefinitions) {
  for (const bool by_own_depths : {false, true}) {
    for (const bool with_ratio : {false, true}) {
      const auto f = [&](const Eigen::VectorXd& errors) -> Eigen::VectorXd {
        Vector7d r = left_over(measure(errors, Noise::Zero(), by_own_depths));
        if (!with_ratio) r(6) = 0;
        return r;
      };
      const DriftObservation model =
          observe(measure(Errors::Zero(), Noise::Zero(), by_own_depths), with_ratio);
      Eigen::Matrix<double, 7, 24> H;
      H << model.H_own, model.H_own_before, model.H_other, model.H_other_before;
      const std::string depths = by_own_depths ? "own depths" : "the other's depths";
      expect_jacobian(depths + (with_ratio ? " and ratio" : ""), H, f);
    }
  }
}

TEST(DriftObservation, NoiseIsThatOfTheMeasurementAndOfDepthsThatAreWrongOtherwise) {
  Matrix7d root = Matrix7d::Identity();
  for (int i = 0; i < 7; ++i) root.row(i).head(i).setLinSpaced(i, -0.3 * i, 0.4);
  const Matrix7d measured_with = 1e-4 * root * root.transpose();
  Eigen::Matrix<double, 9, 9> covariance = Eigen::Matrix<double, 9, 9>::Zero();
  covariance.topLeftCorner<7, 7>() = measured_with;
  covariance.diagonal().tail<2>() << kUnsharedOwn, kUnsharedOther;
  for (const bool by_own_depths : {false, true}) {
    RelativePose measured = measure(Errors::Zero(), Noise::Zero(), by_own_depths);
    measured.covariance = measured_with.topLeftCorner<6, 6>();
    measured.depth_ratio->covariance_with_pose = measured_with.topRightCorner<6, 1>();
    measured.depth_ratio->variance = measured_with(6, 6);
    const auto f = [&](const Eigen::VectorXd& noise) -> Eigen::VectorXd {
      return left_over(measure(Errors::Zero(), noise, by_own_depths));
    };
    const Eigen::MatrixXd J = numeric_jacobian(f, 9);
    const Matrix7d expected = J * covariance * J.transpose();
    EXPECT_TRUE(observe(measured, true).noise.isApprox(expected, 1e-6));
    const Matrix7d without = observe(measured, false).noise;
    const Matrix6d of_pose = expected.topLeftCorner<6, 6>();
    EXPECT_TRUE((without.topLeftCorner<6, 6>().isApprox(of_pose, 1e-6)));
    EXPECT_TRUE((without.rightCols<1>() == Vector7d::Unit(6)));
  }
}

}  // namespace
}  // namespace covey
