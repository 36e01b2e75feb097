// SPDX-License-Identifier: Apache-2.0
#include "estimator/vision_update.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "estimator/observation_model.h"
#include "tests/estimator/filled_window.h"

namespace covey {
namespace {

Eigen::Vector2d expected_bearing(const State& state, const SlamLandmark& landmark) {
  const CameraExtrinsics& extrinsics = state.extrinsics();
  const int anchor = state.find_clone(landmark.anchor_id);
  const Pose& anchor_pose = state.clones()[static_cast<std::size_t>(anchor)].pose;
  const auto point = anchored_point(landmark.inverse_depth, anchor_pose, extrinsics);
  return observe_point(point.p_world, state.clones().back().pose, extrinsics).bearing;
}

// A window with one SLAM feature.
struct Window {
  FilledWindow filled = filled_window(3);
  VisionUpdate vision;

  explicit Window(double slam_noise_scale = 1)
      : vision(scaled(filled.config, slam_noise_scale), filled.state.capacity()) {
    UpdateReport report;
    const std::vector<const Track*> candidates{&filled.tracks.front()};
    EXPECT_EQ(vision.update_tracks(filled.state, {}, candidates, 1, report).size(), 1U);
  }
  static EstimatorConfig scaled(EstimatorConfig config, double slam_noise_scale) {
    config.slam_noise_scale = slam_noise_scale;
    return config;
  }
  [[nodiscard]] Eigen::Vector2d expected() const {
    return expected_bearing(filled.state, filled.state.landmarks().front());
  }
  // The feature is seen `off` from where it is expected.
  UpdateReport see(const Eigen::Vector2d& off, const Eigen::Matrix2d& covariance) {
    UpdateReport report;
    const std::uint64_t id = filled.state.landmarks().front().track_id;
    vision.update_slam(filled.state, {{id, expected() + off, covariance}}, report);
    return report;
  }
  // By how much the expected bearing moves then.
  Eigen::Vector2d moved_by(const Eigen::Vector2d& off, const Eigen::Matrix2d& covariance) {
    const Eigen::Vector2d before = expected();
    EXPECT_EQ(see(off, covariance).slam_used, 1);
    return expected() - before;
  }
};

// Surer along one diagonal than the state is, and of no use along the other.
TEST(VisionUpdate, ABearingCountsInTheDirectionInWhichItIsSure) {
  const Eigen::Vector2d sure = Eigen::Vector2d(1, 1).normalized();
  const Eigen::Vector2d unsure = Eigen::Vector2d(1, -1).normalized();
  const Eigen::Matrix2d covariance =
      1e-10 * sure * sure.transpose() + 1.0 * unsure * unsure.transpose();
  const Eigen::Vector2d off = 2e-4 * (sure + unsure);
  const Eigen::Vector2d moved = Window().moved_by(off, covariance);
  EXPECT_GT(moved.dot(sure), 0.9 * off.dot(sure));
  EXPECT_LT(std::abs(moved.dot(unsure)), 0.3 * off.dot(unsure));
}

TEST(VisionUpdate, SlamFeaturesAreAsUncertainAsErrorsThatLastMakeThem) {
  const Eigen::Matrix2d covariance = 1e-6 * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d off(3e-4, -2e-4);
  const Eigen::Vector2d moved = Window(3).moved_by(off, covariance);
  EXPECT_LT((moved - Window(1).moved_by(off, 9 * covariance)).norm(), 1e-9);
  EXPECT_LT(moved.norm(), 0.9 * Window(1).moved_by(off, covariance).norm());
}

// 20 px: nothing that a sigma of a tenth allows for, however much that is enlarged for lasting.
TEST(VisionUpdate, WhetherASlamFeatureFitsIsAMatterOfOneSight) {
  const Eigen::Matrix2d covariance = 5e-8 * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d off(0.05, 0);
  EXPECT_EQ(Window(1).see(off, covariance).slam_gated, 1);
  EXPECT_EQ(Window(1000).see(off, covariance).slam_gated, 1);
  EXPECT_EQ(Window(1).see(off, 1e6 * covariance).slam_gated, 0);
}

TEST(VisionUpdate, ABearingThatIsNoNumberIsGated) {
  Window window;
  const UpdateReport report = window.see({std::nan(""), 0}, 1e-6 * Eigen::Matrix2d::Identity());
  EXPECT_EQ(report.slam_gated, 1);
  EXPECT_EQ(report.slam_used, 0);
  EXPECT_TRUE(window.expected().allFinite());
}

// What is seen before the start does not hang on how many features an update may use.
TEST(VisionUpdate, WithFewFeaturesOrNoneThereIsAGlimpseAllTheSame) {
  for (const int features : {0, 5}) {
    SCOPED_TRACE(features);
    FilledWindow window = filled_window(3);
    window.config.max_slam_features = 0;
    window.config.max_msckf_features = features;
    VisionUpdate vision(window.config, window.state.capacity());
    EXPECT_TRUE(vision.glimpse(window.state, some_tracks(window, 0, 40)));
  }
}

// Takes so much from the variance of one part of the state that no covariance is left.
void make_impossible(State& state, int row) {
  const Eigen::VectorXd none = Eigen::VectorXd::Zero(state.dimension());
  const Eigen::MatrixXd unit = Eigen::MatrixXd::Identity(state.dimension(), state.dimension());
  state.correct(none, unit.col(row), Eigen::MatrixXd::Constant(1, 1, 1e-2));
}

TEST(VisionUpdate, WhatFailedHasUsedNoSlamFeature) {
  Window window;
  make_impossible(window.filled.state, window.filled.state.landmark_offset(0));
  const Eigen::Vector2d before = window.expected();
  const UpdateReport report = window.see({1e-5, 0}, 1e-6 * Eigen::Matrix2d::Identity());
  EXPECT_EQ(report.failed_updates, 1);
  EXPECT_EQ(report.slam_used, 0);
  EXPECT_EQ(window.expected(), before);
}

TEST(VisionUpdate, WhatFailedHasUsedNoTrack) {
  FilledWindow window = filled_window(3);
  make_impossible(window.state, window.state.clone_offset(5) + 3);
  VisionUpdate vision(window.config, window.state.capacity());
  UpdateReport report;
  (void)vision.update_tracks(window.state, some_tracks(window, 0, 20), {}, 0, report);
  EXPECT_EQ(report.failed_updates, 1);
  EXPECT_EQ(report.msckf_used, 0);
}

// Where variances of the poses are negative, the variance of the depth is too, and has no root.
TEST(VisionUpdate, ADepthOfUnknownErrorIsNotKnown) {
  FilledWindow window = filled_window(3);
  const int n = window.state.dimension();
  window.state.correct(Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Identity(n, n),
                       Eigen::MatrixXd::Identity(n, n));
  VisionUpdate vision(window.config, window.state.capacity());
  UpdateReport report;
  EXPECT_TRUE(vision.update_tracks(window.state, some_tracks(window, 0, 5), {}, 0, report).empty());
  EXPECT_EQ(report.msckf_untriangulated, 5);
}

}  // namespace
}  // namespace covey
