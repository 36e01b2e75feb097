// SPDX-License-Identifier: Apache-2.0
//
// How errors travel through the state: from image to image, into clones, from anchor to anchor, and
// into what a SLAM feature looks like.
#include "estimator/state.h"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <random>
#include <vector>

#include "estimator/imu_transition.h"
#include "estimator/observation_model.h"
#include "estimator/so3.h"
#include "estimator/vision_update.h"
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

ImuState carried(const ImuState& start, const std::vector<ImuSample>& samples) {
  return carried_over(start, integrate_imu(samples, start.gyro_bias, start.accel_bias, ImuNoise()),
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
      integrate_imu(samples, start.gyro_bias, start.accel_bias, ImuNoise());
  const auto at_end = [&](const Eigen::VectorXd& dx) {
    return difference(end, carried(moved(start, dx), samples));
  };
  expect_jacobian("transition", transition(increment, start, end, kGravity), at_end, 1e-5);
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

State calibrating_state() {
  const EstimatorConfig config = calibrating();
  return State(config, CoreState{flying(), config.extrinsics, wrong_intrinsics(),
                                 some_covariance(State::kImuSize + 7 + kIntrinsicsSize)});
}

// What the IMU alone makes of a state without clones is what the filter's own step makes of it.
TEST(State, DeadReckoningIsThePropagationOfTheCore) {
  State state = calibrating_state();
  const EstimatorConfig config = calibrating();
  const std::vector<ImuSample> samples = wobble(0);
  const CoreState alone = dead_reckoned(state.core(), samples, config);
  state.propagate(integrate_imu(samples, flying().gyro_bias, flying().accel_bias, config.imu_noise),
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

// Two keyframes and a landmark, linearised where everything is.
State with_landmark() {
  State state = calibrating_state();
  state.add_clone(1, 0, true, {0.3, -0.6, 0.9});
  const std::vector<ImuSample> samples = wobble(0);
  const EstimatorConfig config = calibrating();
  state.propagate(integrate_imu(samples, flying().gyro_bias, flying().accel_bias, config.imu_noise),
                  samples.back().stamp_ns, config.gravity, config.imu_noise);
  state.add_clone(2, samples.back().stamp_ns, true, {0.2, 0.1, -0.4});
  const Eigen::Vector3d inverse_depth(0.3, -0.2, 0.2);
  state.add_landmark({7, 1, inverse_depth, inverse_depth, 0},
                     Eigen::MatrixXd::Constant(3, state.dimension(), 1e-6),
                     1e-4 * Eigen::Matrix3d::Identity());
  return state;
}

// (x/z, y/z, 1/z) of the landmark in the second keyframe's camera, after an error of the state.
Eigen::VectorXd seen_from_second(State state, const Eigen::VectorXd& dx) {
  state.correct(dx, Eigen::MatrixXd::Zero(state.dimension(), 1));
  const Eigen::Vector3d p_world =
      anchored_point(state.landmarks()[0].inverse_depth, state.clones()[0].pose, state.extrinsics())
          .p_world;
  return inverse_depth_of_point(p_world, state.clones()[1].pose, state.extrinsics()).inverse_depth;
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

TEST(VisionUpdate, MovingTheAnchorCarriesErrorsAsDifferencesDo) {
  State state = with_landmark();
  const Eigen::MatrixXd P = state.covariance(), J = numeric_by_state(state, seen_from_second);
  const Eigen::VectorXd expected =
      seen_from_second(state, Eigen::VectorXd::Zero(state.dimension()));
  UpdateReport report;
  VisionUpdate(calibrating(), state.capacity()).reanchor(state, 0, report);
  ASSERT_EQ(report.slam_reanchored, 1);
  EXPECT_LT((state.landmarks()[0].inverse_depth - expected).norm(), 1e-12);
  const int offset = state.landmark_offset(0);
  EXPECT_LT(
      (state.covariance().middleRows(offset, 3).leftCols(offset) - (J * P).leftCols(offset)).norm(),
      1e-6 * P.norm());
  EXPECT_LT((state.covariance().block(offset, offset, 3, 3) - J * P * J.transpose()).norm(),
            1e-6 * P.norm());
}

TEST(VisionUpdate, ASlamFeatureIsUsedAsDifferencesSay) {
  State state = with_landmark();
  const Eigen::MatrixXd P = state.covariance();
  const Eigen::MatrixXd H = numeric_by_state(state, computed_in_second);
  const Eigen::Vector2d off(1e-3, -2e-3);
  const Eigen::Matrix2d noise = 1e-4 * Eigen::Matrix2d::Identity();
  const Eigen::Matrix2d S = H * P * H.transpose() + noise;
  const Eigen::MatrixXd K = P * H.transpose() * S.inverse();
  const Eigen::Vector3d p_before = state.imu().pose.p_world_imu;
  const IntrinsicsError intrinsics_before = state.intrinsics_error();
  const Eigen::Vector2d expected =
      computed_in_second(state, Eigen::VectorXd::Zero(state.dimension()));
  // About where it is seen.
  const Eigen::Vector2d predicted =
      seen_from_second(state, Eigen::VectorXd::Zero(state.dimension())).head<2>();
  const BearingByIntrinsics by_intrinsics_seen =
      by_intrinsics() + pinhole_by_intrinsics(expected + off) - pinhole_by_intrinsics(predicted);
  UpdateReport report;
  VisionUpdate(calibrating(), state.capacity())
      .update_slam(state, {{7, expected + off, noise, by_intrinsics_seen}}, report);
  ASSERT_EQ(report.slam_used, 1);
  const Eigen::VectorXd dx = K * off;
  EXPECT_LT((state.imu().pose.p_world_imu - p_before - dx.head<3>()).norm(), 1e-6 * dx.norm());
  EXPECT_LT((state.intrinsics_error() - intrinsics_before -
             dx.segment<kIntrinsicsSize>(state.intrinsics_offset()))
                .norm(),
            1e-6 * dx.norm());
  EXPECT_LT((state.covariance() - (P - K * S * K.transpose())).norm(), 1e-6 * P.norm());
}

}  // namespace
}  // namespace covey
