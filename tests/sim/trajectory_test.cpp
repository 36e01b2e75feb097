// SPDX-License-Identifier: Apache-2.0
#include "sim/trajectory.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <stdexcept>

#include "estimator/so3.h"
#include "sim/random.h"
#include "tests/sim/recorded_motion.h"

namespace covey {
namespace {

FlatOutput figure_of_eight(double t) {
  return {{2 * std::sin(0.9 * t), std::sin(1.8 * t), 1.5 + 0.4 * std::sin(1.3 * t)},
          0.8 * std::sin(0.5 * t)};
}

RecordedMotion sampled(const Trajectory& trajectory, double rate_hz, double position_sigma,
                       double attitude_sigma) {
  Random random(7);
  RecordedMotion motion;
  for (int i = 0; i / rate_hz <= trajectory.duration_s(); ++i) {
    Pose pose = trajectory.pose_at(i / rate_hz);
    pose.p_world_imu += position_sigma * random.gaussian_vector();
    pose.q_world_imu = pose.q_world_imu * exp_quaternion(attitude_sigma * random.gaussian_vector());
    motion.times_s.push_back(100 + i / rate_hz);
    motion.poses.push_back(pose);
  }
  return motion;
}

void expect_exact_derivatives(const Trajectory& trajectory) {
  constexpr double kStep = 1e-4;  // s
  for (double t = 0.01; t < trajectory.duration_s() - 0.01; t += 0.0371) {
    const KinematicState now = trajectory.at(t);
    const KinematicState before = trajectory.at(t - kStep), after = trajectory.at(t + kStep);
    const Eigen::Vector3d v = (after.pose.p_world_imu - before.pose.p_world_imu) / (2 * kStep);
    const Eigen::Vector3d a = (after.v_world_imu - before.v_world_imu) / (2 * kStep);
    const Eigen::Vector3d omega =
        (log_quaternion(now.pose.q_world_imu.conjugate() * after.pose.q_world_imu) -
         log_quaternion(now.pose.q_world_imu.conjugate() * before.pose.q_world_imu)) /
        (2 * kStep);
    const Eigen::Vector3d alpha = (after.omega_imu - before.omega_imu) / (2 * kStep);
    ASSERT_LT((v - now.v_world_imu).norm(), 1e-5) << "at " << t << " s";
    ASSERT_LT((a - now.a_world_imu).norm(), 1e-4) << "at " << t << " s";
    ASSERT_LT((omega - now.omega_imu).norm(), 1e-5) << "at " << t << " s";
    ASSERT_LT((alpha - now.alpha_imu).norm(), 1e-3) << "at " << t << " s";
  }
}

TEST(Trajectory, RatesAreTheDerivativesOfThePose) {
  expect_exact_derivatives(Trajectory::multirotor(figure_of_eight, 6));
}

TEST(Trajectory, RecordedMotionHasExactDerivativesToo) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 6);
  const RecordedMotion motion = sampled(flown, 200, 2e-4, 5e-4);
  expect_exact_derivatives(Trajectory::from_poses(motion.times_s, motion.poses));
}

TEST(Trajectory, PoseAloneIsThePoseOfTheFullState) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 3);
  for (double t = -0.5; t < 3.5; t += 0.01) {
    EXPECT_EQ(flown.pose_at(t).p_world_imu, flown.at(t).pose.p_world_imu);
    EXPECT_LT(flown.pose_at(t).q_world_imu.angularDistance(flown.at(t).pose.q_world_imu), 1e-7);
  }
}

TEST(Trajectory, MultirotorThrustPointsAlongBodyZ) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 6);
  for (double t = 0; t < 6; t += 0.05) {
    const KinematicState state = flown.at(t);
    const Eigen::Vector3d thrust_imu =
        state.pose.q_world_imu.conjugate() * (state.a_world_imu + Eigen::Vector3d(0, 0, 9.81));
    EXPECT_LT(thrust_imu.head<2>().norm(), 5e-3) << "m/s2, at " << t << " s";
  }
}

TEST(Trajectory, MultirotorFliesThePathItIsGiven) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 6, 0.05);
  for (double t = 0; t < 6; t += 0.05) {
    const FlatOutput wanted = figure_of_eight(t);
    const Pose pose = flown.pose_at(t);
    EXPECT_LT((pose.p_world_imu - wanted.p_world_imu).norm(), 5e-3);
    const Eigen::Vector3d left = pose.q_world_imu * Eigen::Vector3d::UnitY();
    EXPECT_NEAR(left.dot(Eigen::Vector3d(std::cos(wanted.yaw), std::sin(wanted.yaw), 0)), 0, 1e-3);
  }
}

TEST(Trajectory, RecordedMotionIsFollowedAndItsNoiseIsNotAmplified) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 10);
  for (const double rate_hz : {20.0, 200.0}) {
    const RecordedMotion motion = sampled(flown, rate_hz, 2e-4, 5e-4);
    const Trajectory splined = Trajectory::from_poses(motion.times_s, motion.poses);
    EXPECT_NEAR(splined.duration_s(), 10, 1e-9);
    double accel_error2 = 0, omega_error2 = 0;
    int count = 0;
    for (double t = 0.2; t < 9.8; t += 0.01, ++count) {
      const KinematicState truth = flown.at(t), fit = splined.at(t);
      EXPECT_LT((truth.pose.p_world_imu - fit.pose.p_world_imu).norm(), 1e-3);
      EXPECT_LT(truth.pose.q_world_imu.angularDistance(fit.pose.q_world_imu), 2.5e-3);
      accel_error2 += (truth.a_world_imu - fit.a_world_imu).squaredNorm();
      omega_error2 += (truth.omega_imu - fit.omega_imu).squaredNorm();
    }
    EXPECT_LT(std::sqrt(accel_error2 / count), 0.15) << "m/s2, from " << rate_hz << " Hz";
    EXPECT_LT(std::sqrt(omega_error2 / count), 0.02) << "rad/s, from " << rate_hz << " Hz";
  }
}

TEST(Trajectory, RecordedMotionDoesNotCareForTheSignOfQuaternions) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 4);
  RecordedMotion motion = sampled(flown, 50, 0, 0);
  const Trajectory plain = Trajectory::from_poses(motion.times_s, motion.poses);
  for (std::size_t i = 0; i < motion.poses.size(); i += 3) {
    motion.poses[i].q_world_imu.coeffs() *= -1;
  }
  const Trajectory flipped = Trajectory::from_poses(motion.times_s, motion.poses);
  for (double t = 0; t < 4; t += 0.1) {
    EXPECT_LT((plain.at(t).omega_imu - flipped.at(t).omega_imu).norm(), 1e-5);
  }
}

TEST(Trajectory, AGapInTheRecordingIsBridgedSmoothly) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 6);
  RecordedMotion motion = sampled(flown, 100, 0, 0);
  motion.times_s.erase(motion.times_s.begin() + 200, motion.times_s.begin() + 250);
  motion.poses.erase(motion.poses.begin() + 200, motion.poses.begin() + 250);
  const Trajectory splined = Trajectory::from_poses(motion.times_s, motion.poses);
  for (double t = 1.9; t < 2.7; t += 0.01) {
    const KinematicState truth = flown.at(t), fit = splined.at(t);
    EXPECT_LT((truth.pose.p_world_imu - fit.pose.p_world_imu).norm(), 0.05);
    EXPECT_LT(fit.a_world_imu.norm(), 10);
  }
}

TEST(Trajectory, BadRecordingsAreRefusedWithTheirPlace) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 2);
  const RecordedMotion good = sampled(flown, 20, 0, 0);
  const auto message = [](const RecordedMotion& motion) -> std::string {
    try {
      static_cast<void>(Trajectory::from_poses(motion.times_s, motion.poses));
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_EQ(message(good), "accepted");
  RecordedMotion bad = good;
  bad.times_s[5] = bad.times_s[4];
  EXPECT_NE(message(bad).find("pose 5 is not later"), std::string::npos) << message(bad);
  bad = good;
  bad.poses[6].p_world_imu.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(message(bad).find("pose 6 is not finite"), std::string::npos) << message(bad);
  bad = good;
  bad.poses[7].q_world_imu.coeffs().setZero();
  EXPECT_NE(message(bad).find("pose 7 has a quaternion"), std::string::npos) << message(bad);
  bad = good;
  bad.times_s.resize(3);
  bad.poses.resize(3);
  EXPECT_NE(message(bad).find("at least 6 poses"), std::string::npos) << message(bad);
}

TEST(Trajectory, CanBeEndedEarly) {
  const Trajectory flown = Trajectory::multirotor(figure_of_eight, 6);
  const Trajectory shorter = flown.first_seconds(2);
  EXPECT_EQ(shorter.duration_s(), 2);
  EXPECT_EQ(shorter.pose_at(1.5).p_world_imu, flown.pose_at(1.5).p_world_imu);
  EXPECT_EQ(shorter.pose_at(5).p_world_imu, flown.pose_at(2).p_world_imu);
  EXPECT_EQ(flown.first_seconds(60).duration_s(), flown.duration_s());
}

}  // namespace
}  // namespace covey
