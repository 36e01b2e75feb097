// SPDX-License-Identifier: Apache-2.0
//
// What a peer's landmarks do to the own state, and what they must not do.
#include "estimator/peer_update.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

#include "estimator/chi_square.h"
#include "tests/estimator/filled_window.h"

namespace covey {
namespace {

const double kGate = chi_square_quantile(0.95, 3);

FilledWindow drifted_window() {
  FilledWindow window = filled_window(3);
  add_slam_features(window, 20);
  return window;
}

// What a peer with errors of standard deviation `sigma` and the common drift `drift` would say.
std::vector<WorldMatch> peer_of(const State& state, double sigma, const Eigen::Vector3d& drift) {
  std::vector<WorldMatch> matches;
  for (int i = 0; i < static_cast<int>(state.landmarks().size()); ++i) {
    WorldMatch match;
    match.track_id = state.landmarks()[static_cast<std::size_t>(i)].track_id;
    match.peer = landmark_estimate(state, i);
    match.peer.p_world += drift;
    match.peer.covariance = sigma * sigma * Eigen::Matrix3d::Identity();
    matches.push_back(match);
  }
  return matches;
}

double own_sigma(const State& state) {
  return std::sqrt(landmark_estimate(state, 0).covariance.trace() / 3);
}

// Semidefinite: the newest clone is the present pose itself.
bool positive(const State& state) {
  const Eigen::MatrixXd P = state.covariance();
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(P).eigenvalues().minCoeff() > -1e-10;
}

TEST(PeerUpdate, ABetterInformedPeerMovesTheDroneTowardsIt) {
  FilledWindow window = drifted_window();
  State& state = window.state;
  const double sigma = own_sigma(state);
  const Eigen::Vector3d drift(0, 0, 0.5 * sigma);
  const Pose before = state.imu().pose;
  const double trace = state.covariance().trace();
  const PeerReport report = update_from_peer(state, peer_of(state, sigma / 10, drift), kGate);
  EXPECT_EQ(report.used, 20);
  EXPECT_LT(state.covariance().trace(), trace);
  EXPECT_TRUE(positive(state));
  const Eigen::Vector3d moved = state.imu().pose.p_world_imu - before.p_world_imu;
  EXPECT_GT(moved.dot(drift.normalized()), 0);
}

TEST(PeerUpdate, AnEqualPeerChangesNothing) {
  FilledWindow window = drifted_window();
  const Eigen::MatrixXd before = window.state.covariance();
  const std::vector<WorldMatch> matches =
      peer_of(window.state, own_sigma(window.state), Eigen::Vector3d::Zero());
  const PeerReport report = update_from_peer(window.state, matches, kGate);
  EXPECT_EQ(report.used, 0);
  EXPECT_EQ(report.uninformative, 20);
  EXPECT_EQ((window.state.covariance() - before).norm(), 0);
}

TEST(PeerUpdate, TheSameAnswerAgainDoesNotShrinkTheCovarianceAgain) {
  FilledWindow window = drifted_window();
  State& state = window.state;
  const std::vector<WorldMatch> matches =
      peer_of(state, own_sigma(state) / 10, Eigen::Vector3d::Zero());
  ASSERT_GT(update_from_peer(state, matches, kGate).used, 0);
  const Eigen::MatrixXd once = state.covariance();
  EXPECT_EQ(update_from_peer(state, matches, kGate).used, 0);
  EXPECT_EQ((state.covariance() - once).norm(), 0);
}

TEST(PeerUpdate, NeverClaimsToKnowTheLandmarksBetterThanThePeer) {
  FilledWindow window = drifted_window();
  State& state = window.state;
  const double sigma = own_sigma(state) / 10;
  ASSERT_GT(update_from_peer(state, peer_of(state, sigma, Eigen::Vector3d::Zero()), kGate).used, 0);
  for (int i = 0; i < static_cast<int>(state.landmarks().size()); ++i) {
    EXPECT_GE(landmark_estimate(state, i).covariance.trace(), 3 * sigma * sigma * 0.999);
  }
}

TEST(PeerUpdate, ADisagreeingPeerIsGated) {
  FilledWindow window = drifted_window();
  const double sigma = own_sigma(window.state);
  const Eigen::MatrixXd before = window.state.covariance();
  const std::vector<WorldMatch> matches =
      peer_of(window.state, sigma / 10, Eigen::Vector3d(20 * sigma, 0, 0));
  const PeerReport report = update_from_peer(window.state, matches, kGate);
  EXPECT_EQ(report.gated, 20);
  EXPECT_EQ((window.state.covariance() - before).norm(), 0);
}

TEST(PeerUpdate, WhatCannotBeTrueIsRefused) {
  FilledWindow window = drifted_window();
  std::vector<WorldMatch> matches = peer_of(window.state, own_sigma(window.state) / 10, {0, 0, 0});
  matches[0].peer.p_world.x() = std::numeric_limits<double>::quiet_NaN();
  matches[1].peer.covariance = -Eigen::Matrix3d::Identity();
  matches[2].matching_sigma = std::numeric_limits<double>::infinity();
  matches[3].track_id = 987654321;
  matches.resize(4);
  const PeerReport report = update_from_peer(window.state, matches, kGate);
  EXPECT_EQ(report.invalid, 3);
  EXPECT_EQ(report.unknown_track, 1);
  EXPECT_EQ(report.used, 0);
}

}  // namespace
}  // namespace covey
