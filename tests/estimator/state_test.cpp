// SPDX-License-Identifier: Apache-2.0
//
// How errors travel through the state: from image to image, into clones, from anchor to anchor, and
// into what a SLAM feature looks like.
#include "estimator/state.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <array>
#include <cmath>
#include <random>
#include <vector>

#include "estimator/imu_transition.h"
#include "estimator/observation_model.h"
#include "estimator/slam_update.h"
#include "estimator/so3.h"
#include "tests/estimator/moved_imu.h"
#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

using Vector15d = Eigen::Matrix<double, 15, 1>;

const Eigen::Vector3d kGravity(0, 0, -9.81);

EstimatorConfig calibrating() {
  EstimatorConfig config;
  config.calibrate_extrinsics = config.calibrate_time_offset = config.calibrate_intrinsics = true;
  config.extrinsics.q_imu_cam = exp_quaternion({0.1, -0.2, 0.05});
  config.extrinsics.p_imu_cam = {0.1, -0.05, 0.02};
  return config;
}

ImuState flying() {
  ImuState imu;
  imu.pose = {{1.2, -0.4, 2.1}, exp_quaternion({0.3, -0.2, 1.1})};
  imu.v_world_imu = {0.8, -0.5, 0.3};
  imu.gyro_bias = {0.01, -0.02, 0.03};
  imu.accel_bias = {0.1, 0.05, -0.07};
  return imu;
}

std::vector<ImuSample> wobble(double from_s) {
  std::vector<ImuSample> samples;
  for (int i = 0; i <= 40; ++i) {
    const double t = 0.005 * i;
    samples.push_back({nanoseconds(from_s + t),
                       {0.5 + t, -0.3 + 2 * t, std::sin(9 * t)},
                       {0.2 - t, std::cos(7 * t), 9.6 + 3 * t}});
  }
  return samples;
}

// Without rotation; `accel_imu`: as measured, bias and gravity included.
std::vector<ImuSample> steady(double from_s, double duration_s, const Eigen::Vector3d& accel_imu) {
  constexpr double kStep_s = 0.005;
  std::vector<ImuSample> samples;
  for (int i = 0; i <= static_cast<int>(std::lround(duration_s / kStep_s)); ++i) {
    samples.push_back({nanoseconds(from_s + i * kStep_s), flying().gyro_bias, accel_imu});
  }
  return samples;
}

// What is measured in flight at an acceleration in the world.
Eigen::Vector3d measured(const Eigen::Vector3d& a_world) {
  const ImuState imu = flying();
  return imu.pose.q_world_imu.conjugate() * (a_world - kGravity) + imu.accel_bias;
}

ImuState carried(const ImuState& start, const std::vector<ImuSample>& samples) {
  return carried_over(start,
                      integrate_imu({samples}, start.gyro_bias, start.accel_bias, ImuNoise()),
                      samples.back().stamp_ns, kGravity);
}

Eigen::VectorXd difference(const ImuState& from, const ImuState& to) {
  Vector15d dx;
  dx << to.pose.p_world_imu - from.pose.p_world_imu, to.v_world_imu - from.v_world_imu,
      log_quaternion(from.pose.q_world_imu.conjugate() * to.pose.q_world_imu),
      to.gyro_bias - from.gyro_bias, to.accel_bias - from.accel_bias;
  return dx;
}

TEST(ImuTransition, TheJacobianAgreesWithDifferences) {
  const std::vector<ImuSample> samples = wobble(0);
  const ImuState start = flying(), end = carried(start, samples);
  const ImuIncrement increment =
      integrate_imu({samples}, start.gyro_bias, start.accel_bias, ImuNoise());
  const auto at_end = [&](const Eigen::VectorXd& dx) {
    return difference(end, carried(moved(start, dx), samples));
  };
  expect_jacobian("transition", transition(increment, start, end, kGravity), at_end, 1e-5);
}

// With the error of what is in metres relative to the scale, the camera's place about c. For as
// long as acceleration does not change much.
TEST(ImuTransition, TheScaleMovesThePresentAsDifferencesDo) {
  std::vector<ImuSample> samples = wobble(0);
  samples.resize(5);
  const ImuState start = flying(), end = carried(start, samples);
  const Eigen::Vector3d c(0.3, -0.2, 1.4), p_imu_cam(3, -2, 1);
  const auto camera = [&](const ImuState& imu) -> Eigen::Vector3d {
    return imu.pose.p_world_imu + imu.pose.q_world_imu * p_imu_cam;
  };
  const auto scaled = [&](ImuState imu, double ratio) {
    imu.pose.p_world_imu += (ratio - 1) * (camera(imu) - c);
    imu.v_world_imu *= ratio;
    return imu;
  };
  const auto at_end = [&](const Eigen::VectorXd& ds) {
    const ImuState moved_end = carried(scaled(start, std::exp(ds(0))), samples);
    return difference(end, scaled(moved_end, std::exp(-ds(0))));
  };
  const double dt = seconds_between(samples.front().stamp_ns, samples.back().stamp_ns);
  const Eigen::Vector3d swing =
      (end.pose.q_world_imu * p_imu_cam) - (start.pose.q_world_imu * p_imu_cam);
  EXPECT_GT(swing.norm(), 1e-3);
  expect_jacobian("by scale", transition_by_scale(end.v_world_imu - start.v_world_imu, dt, swing),
                  at_end, 1e-5);
}

Eigen::MatrixXd some_covariance(Eigen::Index size) {
  std::mt19937 generator(1);
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd A =
      Eigen::MatrixXd::NullaryExpr(size, size, [&] { return normal(generator); });
  return 1e-4 * (A * A.transpose() + Eigen::MatrixXd::Identity(size, size));
}

IntrinsicsError wrong_intrinsics() {
  IntrinsicsError error;
  error << 2e-3, -1e-3, 3e-3, 1e-3, -2e-3, 1e-3;
  return error;
}

// All in metres: nothing is said of the scale.
State calibrating_state() {
  const EstimatorConfig config = calibrating();
  Eigen::MatrixXd P = some_covariance(State::kWindow + 7 + kIntrinsicsSize);
  P.row(State::kScale).setZero();
  P.col(State::kScale).setZero();
  return State(config, CoreState{flying(), config.extrinsics, wrong_intrinsics(), P});
}

// What the IMU alone makes of a state without clones is what the filter's own step makes of it.
TEST(State, DeadReckoningIsThePropagationOfTheCore) {
  State state = calibrating_state();
  const EstimatorConfig config = calibrating();
  const std::vector<ImuSample> samples = wobble(0);
  const CoreState alone = dead_reckoned(state.core(), {samples}, config);
  state.propagate(
      integrate_imu({samples}, flying().gyro_bias, flying().accel_bias, config.imu_noise),
      samples.back().stamp_ns, config.gravity, config.imu_noise);
  EXPECT_LT(difference(alone.imu, state.imu()).norm(), 1e-12);
  EXPECT_LT((alone.covariance - state.covariance()).norm(), 1e-12);
  EXPECT_EQ(alone.imu.stamp_ns, samples.back().stamp_ns);
}

// The image was taken at its stamp and the offset: where the drone was then moves with the offset.
TEST(State, ACloneMovesWithTheTimeOffset) {
  State state = calibrating_state();
  const Eigen::MatrixXd P = state.covariance();
  const Eigen::Vector3d rate_imu(0.3, -0.6, 0.9);
  state.add_clone(1, 0, true, rate_imu);
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(state.dimension(), P.cols());
  J.topRows(P.rows()).setIdentity();
  const int clone = state.clone_offset(0);
  J.block<3, 3>(clone, State::kPosition).setIdentity();
  J.block<3, 3>(clone + 3, State::kRotation).setIdentity();
  J.block<3, 1>(clone, state.time_offset_offset()) = state.imu().v_world_imu;
  J.block<3, 1>(clone + 3, state.time_offset_offset()) = rate_imu;
  EXPECT_LT((state.covariance() - J * P * J.transpose()).norm(), 1e-12);
}

TEST(State, ACloneMovesWithTheTimeOffsetAsFastAsIsSeenLater) {
  State state = calibrating_state();
  const int offset = state.time_offset_offset();
  // Corrected by (0.1 t + 0.2 t^2) along x.
  const std::array<double, 4> times_s = {0, 0.5, 0.7, 1.5};
  for (std::size_t i = 0; i < times_s.size(); ++i) {
    state.add_clone(i + 1, nanoseconds(times_s[i]), true, Eigen::Vector3d::Zero());
  }
  State seen = state;
  Eigen::VectorXd moved = Eigen::VectorXd::Zero(state.dimension());
  Eigen::MatrixXd M = Eigen::MatrixXd::Identity(state.dimension(), state.dimension());
  for (std::size_t i = 0; i < times_s.size(); ++i) {
    const double t = times_s[i];
    const int x = state.clone_offset(static_cast<int>(i));
    moved(x) = 0.1 * t + 0.2 * t * t;
    M(x, offset) = 0.1 + 0.4 * t;
  }
  seen.correct(moved, Eigen::MatrixXd::Zero(state.dimension(), 1));
  const Eigen::MatrixXd before = state.covariance();
  state.relinearize_time_offset(seen);
  EXPECT_LT((state.covariance() - M * before * M.transpose()).norm(), 1e-12);
}

// Two keyframes and a landmark, linearised where everything is.
State with_landmark_in_metres() {
  State state = calibrating_state();
  state.add_clone(1, 0, true, {0.3, -0.6, 0.9});
  const std::vector<ImuSample> samples = wobble(0);
  const EstimatorConfig config = calibrating();
  state.propagate(
      integrate_imu({samples}, flying().gyro_bias, flying().accel_bias, config.imu_noise),
      samples.back().stamp_ns, config.gravity, config.imu_noise);
  state.add_clone(2, samples.back().stamp_ns, true, {0.2, 0.1, -0.4});
  const Eigen::Vector3d inverse_depth(0.3, -0.2, 0.2);
  Eigen::MatrixXd cross = Eigen::MatrixXd::Constant(3, state.dimension(), 1e-6);
  cross.col(State::kScale).setZero();
  state.add_landmark({7, 1, inverse_depth, inverse_depth, 0}, cross,
                     1e-4 * Eigen::Matrix3d::Identity());
  return state;
}

State with_landmark() {
  State state = with_landmark_in_metres();
  state.separate_scale();
  return state;
}

TEST(State, ASeparateScaleChangesNothingInMetres) {
  State state = with_landmark_in_metres();
  const Eigen::MatrixXd P = state.covariance();
  EXPECT_NEAR(state.common_depth_sigma(), 0.05, 1e-9);
  state.separate_scale();
  const int scale = State::kScale, rho = state.landmark_offset(0) + 2;
  const double value = state.landmarks()[0].inverse_depth.z();
  EXPECT_NEAR(state.covariance()(scale, scale), P(rho, rho) / (value * value), 1e-12);
  EXPECT_NEAR(state.common_depth_sigma(), 0, 1e-6) << "the only depth is all of the scale";
  EXPECT_LT((state.metric_covariance(state.dimension()) - P).norm(), 1e-12);
  const int core = state.clones_offset();
  EXPECT_LT((state.core().covariance - P.topLeftCorner(core, core)).norm(), 1e-12);
  state.merge_scale();
  EXPECT_LT((state.covariance() - P).norm(), 1e-12);
}

Eigen::Vector3d camera_of(const State& state, const Pose& pose) {
  return camera_pose(pose, state.extrinsics()).p_world_cam;
}

// As long as there is no landmark.
TEST(State, TheScaleOfClonesAloneIsHowFarTheyAreApart) {
  State state = with_landmark_in_metres();
  state.remove_landmark(0);
  const Eigen::MatrixXd P = state.covariance();
  state.separate_scale();
  const int first = state.clone_offset(0), second = state.clone_offset(1);
  const Eigen::Vector3d way =
      camera_of(state, state.clones()[1].pose) - camera_of(state, state.clones()[0].pose);
  const Eigen::Matrix3d P_way = P.block<3, 3>(first, first) + P.block<3, 3>(second, second) -
                                P.block<3, 3>(first, second) - P.block<3, 3>(second, first);
  const double squared = way.squaredNorm();
  const int scale = State::kScale;
  EXPECT_NEAR(state.covariance()(scale, scale), way.dot(P_way * way) / (squared * squared), 1e-9);
  EXPECT_LT((state.metric_covariance(state.dimension()) - P).norm(), 1e-9);
}

// The same motion, and the same news of it, in either description: it stands out of the noise.
TEST(State, WithASeparateScaleItPropagatesAsInMetres) {
  const EstimatorConfig config = calibrating();
  State apart = with_landmark(), in_metres = with_landmark_in_metres();
  const ImuState imu = apart.imu();
  const std::vector<ImuSample> samples = steady(0.2, 0.2, {1, 2, 15});
  for (State* state : {&apart, &in_metres}) {
    state->forget_first_estimates();
    state->propagate(integrate_imu({samples}, imu.gyro_bias, imu.accel_bias, config.imu_noise),
                     samples.back().stamp_ns, config.gravity, config.imu_noise);
  }
  const Eigen::MatrixXd P = in_metres.covariance();
  EXPECT_LT((apart.metric_covariance(apart.dimension()) - P).norm(), 1e-4 * P.norm());
}

// How far the velocity's error goes with the scale's, along `direction`.
double velocity_by_scale(const State& state, const Eigen::Vector3d& direction) {
  const int scale = State::kScale;
  const Eigen::MatrixXd P = state.covariance();
  return direction.dot(P.block<3, 1>(State::kVelocity, scale)) / P(scale, scale);
}

constexpr double kImage_s = 0.05;

ImuIncrement image_at(const Eigen::Vector3d& a_world) {
  return integrate_imu({steady(0, kImage_s, measured(a_world))}, flying().gyro_bias,
                       flying().accel_bias, calibrating().imu_noise);
}

void propagate_images(State& state, const ImuIncrement& image, int images) {
  const EstimatorConfig config = calibrating();
  for (int i = 0; i < images; ++i) {
    const TimeNs stamp_ns = state.imu().stamp_ns + nanoseconds(kImage_s);
    state.propagate(image, stamp_ns, config.gravity, config.imu_noise);
  }
}

// With a scale that stands by itself, after one image.
State accelerating(const ImuIncrement& image) {
  Matrix15d P = Matrix15d::Zero();
  P.diagonal().segment<3>(State::kVelocity).setConstant(1e-4);
  State state(calibrating(), flying(), P);
  state.add_clone(1, 0, true, Eigen::Vector3d::Zero());
  propagate_images(state, image, 1);
  state.add_clone(2, nanoseconds(kImage_s), true, Eigen::Vector3d::Zero());
  state.separate_scale();
  return state;
}

// What velocity changes by tells of the scale. An image's worth of 5 mm/s2 does not stand out of
// the accelerometer's noise; that it lasts does.
TEST(State, WhatDoesNotStandOutOfTheNoiseTellsOfTheScaleOnlyWhenItLasts) {
  const Eigen::Vector3d forward = Eigen::Vector3d::UnitX();
  const auto told_after = [&](double acceleration, int images) {
    const ImuIncrement image = image_at(acceleration * forward);
    State state = accelerating(image);
    const double before = velocity_by_scale(state, forward);
    propagate_images(state, image, images);
    return (before - velocity_by_scale(state, forward)) / (images * acceleration * kImage_s);
  };
  EXPECT_NEAR(told_after(2, 1), 1, 1e-2);
  EXPECT_NEAR(told_after(0.005, 1), 0, 0.01);
  EXPECT_NEAR(told_after(0.005, 20), 0.2, 0.1);
  EXPECT_GT(told_after(0.005, 200), 0.7);
}

// A peer is met in metres; what has lasted lasts.
TEST(State, WhatHasLastedIsNotForgottenWhereTheScaleIsMergedForAMoment) {
  constexpr double kAcceleration = 0.005;
  const Eigen::Vector3d forward = Eigen::Vector3d::UnitX();
  const ImuIncrement image = image_at(kAcceleration * forward);
  State state = accelerating(image);
  propagate_images(state, image, 200);
  state.merge_scale();
  state.separate_scale();
  const double before = velocity_by_scale(state, forward);
  propagate_images(state, image, 1);
  EXPECT_GT((before - velocity_by_scale(state, forward)) / (kAcceleration * kImage_s), 0.9);
}

TEST(State, ACorrectionOfTheScaleLeavesTheCameraOfTheWindowsOldestCloneWhereItIs) {
  State state = with_landmark();
  const State before = state;
  Eigen::VectorXd dx = Eigen::VectorXd::Zero(state.dimension());
  dx(State::kScale) = std::log(2.0);
  state.correct(dx, Eigen::MatrixXd::Zero(state.dimension(), 1));
  const Eigen::Vector3d c = camera_of(before, before.clones()[0].pose);
  const auto expect_at = [](const Eigen::Vector3d& expected, const Eigen::Vector3d& value) {
    EXPECT_LT((value - expected).norm(), 1e-12);
  };
  const auto doubled = [&](const Pose& pose) -> Eigen::Vector3d {
    return c + 2 * (camera_of(before, pose) - c);
  };
  expect_at(c, camera_of(state, state.clones()[0].pose));
  expect_at(doubled(before.clones()[1].first), camera_of(state, state.clones()[1].first));
  expect_at(doubled(before.imu().pose), camera_of(state, state.imu().pose));
  expect_at(2 * before.imu().v_world_imu, state.imu().v_world_imu);
  EXPECT_NEAR(state.landmarks()[0].inverse_depth.z(), before.landmarks()[0].inverse_depth.z() / 2,
              1e-12);
  const int v = State::kVelocity;
  EXPECT_LT(
      (state.covariance().block<3, 3>(v, v) - 4 * before.covariance().block<3, 3>(v, v)).norm(),
      1e-12);
}

// (x/z, y/z, 1/z) of the landmark in the second keyframe's camera, after an error of the state;
// relative to the scale.
Eigen::VectorXd seen_from_second(State state, const Eigen::VectorXd& dx) {
  state.correct(dx, Eigen::MatrixXd::Zero(state.dimension(), 1));
  const Eigen::Vector3d p_world =
      anchored_point(state.landmarks()[0].inverse_depth, state.clones()[0].pose, state.extrinsics())
          .p_world;
  Eigen::Vector3d seen =
      inverse_depth_of_point(p_world, state.clones()[1].pose, state.extrinsics()).inverse_depth;
  seen.z() *= std::exp(dx(State::kScale));
  return seen;
}

template <typename Function>
Eigen::MatrixXd numeric_by_state(const State& state, const Function& f) {
  return numeric_jacobian([&](const Eigen::VectorXd& dx) { return f(state, dx); },
                          state.dimension());
}

// As a camera computes its bearing whose intrinsics are wrong: about where the landmark is.
BearingByIntrinsics by_intrinsics() {
  BearingByIntrinsics J;
  J << 0.3, 0.02, 1.1, 0.05, 0.2, 0.1, -0.01, -0.2, 0.03, 1.2, -0.1, -0.3;
  return J;
}

Eigen::VectorXd computed_in_second(State state, const Eigen::VectorXd& dx) {
  const Eigen::Vector2d bearing = seen_from_second(state, dx).head<2>();
  state.correct(dx, Eigen::MatrixXd::Zero(state.dimension(), 1));
  return bearing + by_intrinsics() * state.intrinsics_error();
}

TEST(SlamUpdate, MovingTheAnchorCarriesErrorsAsDifferencesDo) {
  State state = with_landmark();
  const Eigen::MatrixXd P = state.covariance(), J = numeric_by_state(state, seen_from_second);
  const Eigen::VectorXd expected =
      seen_from_second(state, Eigen::VectorXd::Zero(state.dimension()));
  reanchor(state, 0);
  ASSERT_EQ(state.landmarks().size(), 1u);
  ASSERT_EQ(state.landmarks()[0].anchor_id, state.clones()[1].id);
  EXPECT_LT((state.landmarks()[0].inverse_depth - expected).norm(), 1e-12);
  const int offset = state.landmark_offset(0);
  EXPECT_LT(
      (state.covariance().middleRows(offset, 3).leftCols(offset) - (J * P).leftCols(offset)).norm(),
      1e-6 * P.norm());
  EXPECT_LT((state.covariance().block(offset, offset, 3, 3) - J * P * J.transpose()).norm(),
            1e-6 * P.norm());
}

TEST(SlamUpdate, ASlamFeatureIsUsedAsDifferencesSay) {
  State state = with_landmark();
  const Eigen::MatrixXd P = state.covariance();
  const Eigen::MatrixXd H = numeric_by_state(state, computed_in_second);
  const Eigen::Vector2d off(1e-3, -2e-3);
  const Eigen::Matrix2d noise = 1e-4 * Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d S = H * P * H.transpose() + noise;
  const Eigen::MatrixXd K = P * H.transpose() * S.inverse();
  State updated = state;
  updated.correct(K * off, K * Eigen::MatrixXd(S.llt().matrixL()));
  const Eigen::Vector2d expected =
      computed_in_second(state, Eigen::VectorXd::Zero(state.dimension()));
  // About where it is seen.
  const Eigen::Vector2d predicted =
      seen_from_second(state, Eigen::VectorXd::Zero(state.dimension())).head<2>();
  const BearingByIntrinsics by_intrinsics_seen =
      by_intrinsics() + pinhole_by_intrinsics(expected + off) - pinhole_by_intrinsics(predicted);
  UpdateReport report;
  SlamUpdate(calibrating(), state.capacity())
      .update(state, {{7, expected + off, noise, by_intrinsics_seen}}, report);
  ASSERT_EQ(report.slam_used, 1);
  const double moved = (K * off).norm();
  EXPECT_LT((state.imu().pose.p_world_imu - updated.imu().pose.p_world_imu).norm(), 1e-6 * moved);
  EXPECT_LT((state.intrinsics_error() - updated.intrinsics_error()).norm(), 1e-6 * moved);
  EXPECT_LT((state.covariance() - updated.covariance()).norm(), 1e-6 * P.norm());
}

}  // namespace
}  // namespace covey
