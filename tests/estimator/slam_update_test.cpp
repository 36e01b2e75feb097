// SPDX-License-Identifier: Apache-2.0
#include "estimator/slam_update.h"

#include <gtest/gtest.h>

#include <cmath>

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
  SlamUpdate slam;

  explicit Window(double slam_noise_scale = 1)
      : slam(scaled(filled.config, slam_noise_scale), filled.state.capacity()) {
    add_slam_features(filled, 1);
    EXPECT_EQ(filled.state.landmarks().size(), 1U);
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
    slam.update(filled.state, {{id, expected() + off, covariance}}, report);
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
TEST(SlamUpdate, ABearingCountsInTheDirectionInWhichItIsSure) {
  const Eigen::Vector2d sure = Eigen::Vector2d(1, 1).normalized();
  const Eigen::Vector2d unsure = Eigen::Vector2d(1, -1).normalized();
  const Eigen::Matrix2d covariance =
      1e-10 * sure * sure.transpose() + 1.0 * unsure * unsure.transpose();
  const Eigen::Vector2d off = 2e-4 * (sure + unsure);
  const Eigen::Vector2d moved = Window().moved_by(off, covariance);
  EXPECT_GT(moved.dot(sure), 0.9 * off.dot(sure));
  EXPECT_LT(std::abs(moved.dot(unsure)), 0.3 * off.dot(unsure));
}

TEST(SlamUpdate, SlamFeaturesAreAsUncertainAsErrorsThatLastMakeThem) {
  const Eigen::Matrix2d covariance = 1e-6 * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d off(3e-4, -2e-4);
  const Eigen::Vector2d moved = Window(3).moved_by(off, covariance);
  EXPECT_LT((moved - Window(1).moved_by(off, 9 * covariance)).norm(), 1e-9);
  EXPECT_LT(moved.norm(), 0.9 * Window(1).moved_by(off, covariance).norm());
}

// 20 px: nothing that a sigma of a tenth allows for, however much that is enlarged for lasting.
TEST(SlamUpdate, WhetherASlamFeatureFitsIsAMatterOfOneSight) {
  const Eigen::Matrix2d covariance = 5e-8 * Eigen::Matrix2d::Identity();
  const Eigen::Vector2d off(0.05, 0);
  EXPECT_EQ(Window(1).see(off, covariance).slam_gated, 1);
  EXPECT_EQ(Window(1000).see(off, covariance).slam_gated, 1);
  EXPECT_EQ(Window(1).see(off, 1e6 * covariance).slam_gated, 0);
}

TEST(SlamUpdate, ABearingThatIsNoNumberIsGated) {
  Window window;
  const UpdateReport report = window.see({std::nan(""), 0}, 1e-6 * Eigen::Matrix2d::Identity());
  EXPECT_EQ(report.slam_gated, 1);
  EXPECT_EQ(report.slam_used, 0);
  EXPECT_TRUE(window.expected().allFinite());
}

TEST(SlamUpdate, WhatFailedHasUsedNoSlamFeature) {
  Window window;
  make_impossible(window.filled.state, window.filled.state.landmark_offset(0));
  const Eigen::Vector2d before = window.expected();
  const UpdateReport report = window.see({1e-5, 0}, 1e-6 * Eigen::Matrix2d::Identity());
  EXPECT_EQ(report.failed_updates, 1);
  EXPECT_EQ(report.slam_used, 0);
  EXPECT_EQ(window.expected(), before);
}

}  // namespace
}  // namespace covey
