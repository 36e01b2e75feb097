// SPDX-License-Identifier: Apache-2.0
//
// What a peer's landmarks do to the own state, and what they must not do.
#include "estimator/peer_update.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/QR>
#include <cmath>
#include <limits>
#include <random>

#include "estimator/so3.h"
#include "tests/estimator/filled_window.h"
#include "tests/estimator/numeric_jacobian.h"

namespace covey {
namespace {

const PeerGate kGate(0.95);

FilledWindow drifted_window(int slam_features = 10) {
  FilledWindow window = filled_window(3);
  add_slam_features(window, slam_features);
  return window;
}

Eigen::Isometry3d peer_camera(const State& state) {
  const CameraPose own = camera_pose(state.clones().back().pose, state.extrinsics());
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = own.R_world_cam * exp_so3({0.05, -0.1, 0.02});
  T.translation() = own.p_world_cam + Eigen::Vector3d(0.4, -0.8, 0.3);
  return T;
}

Eigen::Vector3d landmark_in_world(const State& state, const SlamLandmark& landmark) {
  const Clone& anchor =
      state.clones()[static_cast<std::size_t>(state.find_clone(landmark.anchor_id))];
  return anchored_point(landmark.inverse_depth, anchor.pose, state.extrinsics()).p_world;
}

// The track as it would be without any noise, of a point about where it was triangulated.
Track exact(const State& state, VisionUpdate& vision, Track track) {
  const auto rows = vision.upper_rows(state, track, Eigen::Vector3d::Zero());
  const Eigen::Vector3d p_world = landmark_in_world(state, rows->landmark);
  for (CloneObservation& o : track.observations) {
    const Clone& clone = state.clones()[static_cast<std::size_t>(state.find_clone(o.clone_id))];
    o.bearing = observe_point(p_world, clone.pose, state.extrinsics()).bearing;
  }
  return track;
}

// Tracks behind those that the SLAM features were made of.
std::vector<Track> exact_tracks(const FilledWindow& window, VisionUpdate& vision, int count) {
  std::vector<Track> tracks;
  for (auto track = window.tracks.rbegin(); static_cast<int>(tracks.size()) < count; ++track) {
    tracks.push_back(exact(window.state, vision, *track));
  }
  return tracks;
}

// A peer that agrees with the own state, then drifts; `sigma`: m of its position, and a tenth of it
// in rad of its attitude.
struct Peer {
  double sigma = 0.01;
  Eigen::Vector3d drift = Eigen::Vector3d::Zero();
};

SharedKeyframe keyframe_of(const State& state, const std::vector<Track>& tracks,
                           VisionUpdate& vision, const Peer& peer) {
  SharedKeyframe keyframe;
  keyframe.T_world_other = peer_camera(state);
  const Eigen::Isometry3d T_other_world = keyframe.T_world_other.inverse();
  const auto share = [&](const LandmarkRows& rows) {
    SharedLandmark landmark;
    landmark.own = rows;
    landmark.p_other = T_other_world * landmark_in_world(state, rows.landmark);
    landmark.covariance = 0.01 * 0.01 * Eigen::Matrix3d::Identity();
    keyframe.landmarks.push_back(landmark);
  };
  for (int i = 0; i < static_cast<int>(state.landmarks().size()); ++i) share(rows_of(state, i));
  for (const Track& track : tracks) {
    const auto rows = vision.upper_rows(state, track, Eigen::Vector3d::Zero());
    if (rows) share(*rows);
  }
  keyframe.other.T_world_cam = keyframe.T_world_other;
  keyframe.other.T_world_cam.translation() += peer.drift;
  keyframe.other.covariance = peer.sigma * peer.sigma * Matrix6d::Identity();
  keyframe.other.covariance.bottomRightCorner<3, 3>() *= 0.01;
  return keyframe;
}

SharedKeyframe keyframe_of(const FilledWindow& window, const Peer& peer) {
  VisionUpdate vision(window.config, window.state.capacity());
  return keyframe_of(window.state, exact_tracks(window, vision, 10), vision, peer);
}

// Of the keyframe's position, m.
double own_sigma(const State& state, const SharedKeyframe& keyframe) {
  const auto own = sight(state, keyframe);
  const Eigen::MatrixXd S = own->Y * state.covariance() * own->Y.transpose();
  return std::sqrt(S.topLeftCorner<3, 3>().trace() / 3);
}

// Semidefinite: the newest clone is the present pose itself.
bool positive(const State& state) {
  const Eigen::MatrixXd P = state.covariance();
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(P, Eigen::EigenvaluesOnly)
             .eigenvalues()
             .minCoeff() > -1e-10;
}

TEST(PeerUpdate, DerivativesOfTheSightedPoseAgreeWithDifferences) {
  const FilledWindow window = drifted_window();
  VisionUpdate vision(window.config, window.state.capacity());
  State state = window.state;
  state.forget_first_estimates();  // that differences are taken where derivatives are
  const std::vector<Track> tracks = exact_tracks(window, vision, 6);
  const SharedKeyframe at = keyframe_of(state, tracks, vision, {});
  const auto own = sight(state, at);
  ASSERT_TRUE(own);
  const int scale = State::kScale;  // a peer is only met in metres
  const auto moved = [&](Eigen::VectorXd dx) -> Eigen::VectorXd {
    State other = state;
    dx(scale) = 0;
    other.correct(dx, Eigen::MatrixXd::Zero(dx.size(), 1));
    SharedKeyframe keyframe = at;
    std::size_t i = 0;
    for (; i < state.landmarks().size(); ++i) {
      keyframe.landmarks[i].own = rows_of(other, static_cast<int>(i));
    }
    for (const Track& track : tracks) {
      keyframe.landmarks[i++].own = *vision.upper_rows(other, track, Eigen::Vector3d::Zero());
    }
    const auto sighting = sight(other, keyframe);
    Eigen::VectorXd change(6);
    change << sighting->T_world_other.translation() - own->T_world_other.translation(),
        log_so3(sighting->T_world_other.linear() * own->T_world_other.linear().transpose());
    return change;
  };
  Eigen::MatrixXd Y = own->Y;
  Y.col(scale).setZero();
  expect_jacobian("Y", Y, moved, 1e-3, 1e-5);
}

TEST(PeerUpdate, ATrackSaysWhatTheSlamFeatureMadeOfItSays) {
  const FilledWindow window = filled_window(3);
  VisionUpdate vision(window.config, window.state.capacity());
  const std::vector<const Track*> track = some_tracks(window, 4, 1);
  State as_feature = window.state, as_rows = window.state;
  UpdateReport report;
  ASSERT_EQ(vision.update_tracks(as_feature, {}, track, 1, report).size(), 1u);
  ASSERT_EQ(vision.update_tracks(as_rows, track, {}, 0, report).size(), 1u);
  ASSERT_EQ(as_feature.landmarks().size(), 1u);
  const auto rows = vision.upper_rows(as_rows, *track.front(), Eigen::Vector3d::Zero());
  ASSERT_TRUE(rows);
  const Eigen::Matrix3d R_inverse = Eigen::Matrix3d(rows->R).inverse();
  const Eigen::Vector3d f = rows->landmark.inverse_depth + R_inverse * rows->r;
  const Eigen::Matrix3d covariance =
      R_inverse * (rows->H * as_rows.covariance() * rows->H.transpose() + rows->noise) *
      R_inverse.transpose();
  const int offset = as_feature.landmark_offset(0);
  const Eigen::Matrix3d of_feature = as_feature.covariance().block<3, 3>(offset, offset);
  EXPECT_LT((f - as_feature.landmarks()[0].inverse_depth).norm(), 1e-4);
  EXPECT_LT((covariance - of_feature).norm(), 1e-3 * of_feature.norm());
}

// Paper, eq. 11..13: both drones' upper rows, projected to where the landmark is not in them.
TEST(PeerUpdate, TheProjectedResidualOfTwoDronesIsTheDifferenceOfTheirPoints) {
  const FilledWindow window = filled_window(3);
  VisionUpdate vision(window.config, window.state.capacity());
  const auto own = vision.upper_rows(window.state, window.tracks[0], Eigen::Vector3d::Zero());
  const auto peer = vision.upper_rows(window.state, window.tracks[1], Eigen::Vector3d::Zero());
  ASSERT_TRUE(own && peer);
  const Eigen::Matrix3d H_0 = own->R, H_1 = peer->R;
  const Eigen::Vector3d r_0(0.7, -1.2, 0.4), r_1(-0.3, 0.9, 1.1);
  const auto covariance = [&](const LandmarkRows& rows) -> Eigen::Matrix3d {
    return rows.H * window.state.covariance() * rows.H.transpose() + rows.noise;
  };
  Eigen::MatrixXd stacked(6, 3);
  stacked << H_0, H_1;
  const Eigen::MatrixXd Q = Eigen::HouseholderQR<Eigen::MatrixXd>(stacked).householderQ();
  const Eigen::MatrixXd A = Q.rightCols(3).transpose();  // left null space
  Eigen::VectorXd r(6);
  r << r_0, r_1;
  Eigen::MatrixXd S = Eigen::MatrixXd::Zero(6, 6);
  S.topLeftCorner<3, 3>() = covariance(*own);
  S.bottomRightCorner<3, 3>() = covariance(*peer);
  const Eigen::VectorXd projected = A * r;
  const double by_projection = projected.dot((A * S * A.transpose()).ldlt().solve(projected));

  const Eigen::Vector3d difference = H_0.inverse() * r_0 - H_1.inverse() * r_1;
  const Eigen::Matrix3d of_points = H_0.inverse() * covariance(*own) * H_0.inverse().transpose() +
                                    H_1.inverse() * covariance(*peer) * H_1.inverse().transpose();
  const double by_points = difference.dot(of_points.inverse() * difference);
  EXPECT_NEAR(by_projection, by_points, 1e-6 * by_points);
}

TEST(PeerUpdate, ATrackOfOneBearingHelpsAsWell) {
  const FilledWindow window = drifted_window(4);
  VisionUpdate vision(window.config, window.state.capacity());
  std::vector<Track> tracks = exact_tracks(window, vision, 10);
  SharedKeyframe keyframe = keyframe_of(window.state, {}, vision, {});
  const Eigen::Matrix3d alone = sight(window.state, keyframe)->noise.topLeftCorner<3, 3>();
  const SharedKeyframe all = keyframe_of(window.state, tracks, vision, {});
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    SharedLandmark landmark = all.landmarks[window.state.landmarks().size() + i];
    tracks[i].observations = {tracks[i].observations.back()};
    const auto rows =
        vision.upper_rows(window.state, tracks[i], all.T_world_other * landmark.p_other);
    ASSERT_TRUE(rows);
    ASSERT_EQ(rows->r.size(), 2);
    landmark.own = *rows;
    keyframe.landmarks.push_back(landmark);
  }
  const auto together = sight(window.state, keyframe);
  ASSERT_TRUE(together);
  EXPECT_LT((together->T_world_other.translation() - all.T_world_other.translation()).norm(), 1e-3);
  EXPECT_LT((together->noise.topLeftCorner<3, 3>()).trace(), alone.trace());
}

TEST(PeerUpdate, ABetterInformedPeerMovesTheDroneTowardsIt) {
  FilledWindow window = drifted_window();
  State& state = window.state;
  const double sigma = own_sigma(state, keyframe_of(window, {}));
  const Eigen::Vector3d drift(0, 0, 0.5 * sigma);
  const Pose before = state.imu().pose;
  const Eigen::VectorXd variances = state.covariance().diagonal();
  const PeerReport report =
      update_from_peer(state, keyframe_of(window, {sigma / 10, drift}), kGate);
  EXPECT_EQ(report.used, 20);
  EXPECT_TRUE(positive(state));
  EXPECT_LT(state.covariance().trace(), variances.sum());
  // Nothing is inflated, be it involved or not.
  EXPECT_LT((state.covariance().diagonal() - variances).maxCoeff(), 1e-9);
  const Eigen::Vector3d moved = state.imu().pose.p_world_imu - before.p_world_imu;
  EXPECT_GT(moved.dot(drift), 0.5 * drift.squaredNorm());
}

TEST(PeerUpdate, AnEqualPeerChangesNothing) {
  FilledWindow window = drifted_window();
  State& state = window.state;
  SharedKeyframe keyframe = keyframe_of(window, {});
  const auto own = sight(state, keyframe);
  keyframe.other.covariance = own->Y * state.covariance() * own->Y.transpose() + own->noise;
  const Eigen::MatrixXd before = state.covariance();
  const PeerReport report = update_from_peer(state, keyframe, kGate);
  EXPECT_EQ(report.used, 0);
  EXPECT_EQ(report.uninformative, 20);
  EXPECT_EQ((state.covariance() - before).norm(), 0);
}

TEST(PeerUpdate, TheSameAnswerAgainDoesNotShrinkTheCovarianceAgain) {
  FilledWindow window = drifted_window();
  State& state = window.state;
  const SharedKeyframe keyframe =
      keyframe_of(window, {own_sigma(state, keyframe_of(window, {})) / 10, {0, 0, 0}});
  ASSERT_GT(update_from_peer(state, keyframe, kGate).used, 0);
  const Eigen::MatrixXd once = state.covariance();
  EXPECT_EQ(update_from_peer(state, keyframe, kGate).used, 0);
  EXPECT_EQ((state.covariance() - once).norm(), 0);
}

TEST(PeerUpdate, NeverClaimsToKnowTheKeyframeBetterThanThePeer) {
  FilledWindow window = drifted_window();
  const double sigma = own_sigma(window.state, keyframe_of(window, {})) / 10;
  const SharedKeyframe keyframe = keyframe_of(window, {sigma, {0, 0, 0}});
  ASSERT_GT(update_from_peer(window.state, keyframe, kGate).used, 0);
  const auto own = sight(window.state, keyframe);
  const Eigen::MatrixXd S = own->Y * window.state.covariance() * own->Y.transpose() + own->noise;
  const double claimed = S.topLeftCorner<3, 3>().trace();
  EXPECT_GE(claimed, 3 * sigma * sigma * 0.999);
}

TEST(PeerUpdate, ADisagreeingPeerIsGated) {
  FilledWindow window = drifted_window();
  const double sigma = own_sigma(window.state, keyframe_of(window, {}));
  const Eigen::MatrixXd before = window.state.covariance();
  const PeerReport report =
      update_from_peer(window.state, keyframe_of(window, {sigma / 10, {20 * sigma, 0, 0}}), kGate);
  EXPECT_EQ(report.gated, 20);
  EXPECT_EQ((window.state.covariance() - before).norm(), 0);
}

TEST(PeerUpdate, WrongMatchesAreGatedAndTheOthersUsed) {
  FilledWindow window = drifted_window();
  const double sigma = own_sigma(window.state, keyframe_of(window, {}));
  const Pose before = window.state.imu().pose;
  SharedKeyframe keyframe = keyframe_of(window, {sigma / 10, {0, 0, 0}});
  std::swap(keyframe.landmarks[2].own, keyframe.landmarks[5].own);    // SLAM features
  std::swap(keyframe.landmarks[12].own, keyframe.landmarks[15].own);  // tracks
  const PeerReport report = update_from_peer(window.state, keyframe, kGate);
  EXPECT_EQ(report.gated, 4);
  EXPECT_EQ(report.used, 16);
  EXPECT_LT((window.state.imu().pose.p_world_imu - before.p_world_imu).norm(), sigma / 10);
}

TEST(PeerUpdate, WhatCannotBeTrueIsRefused) {
  FilledWindow window = drifted_window();
  const SharedKeyframe good = keyframe_of(window, {});
  SharedKeyframe bad = good;
  bad.landmarks.resize(2);
  bad.landmarks[0].p_other.x() = std::numeric_limits<double>::quiet_NaN();
  bad.landmarks[1].covariance = -Eigen::Matrix3d::Identity();
  EXPECT_EQ(update_from_peer(window.state, bad, kGate).invalid, 2);
  SharedKeyframe no_pose = good;
  no_pose.other.covariance(0, 0) = -1;
  const PeerReport report = update_from_peer(window.state, no_pose, kGate);
  EXPECT_EQ(report.invalid, 20);
  EXPECT_EQ(report.used, 0);
}

// All poses drift by the same translation, again and again, and peers of any quality help.
TEST(PeerUpdate, TheCovarianceStaysPositiveOverThousandsOfUpdates) {
  FilledWindow window = drifted_window(8);
  State& state = window.state;
  VisionUpdate vision(window.config, state.capacity());
  Eigen::MatrixXd G = Eigen::MatrixXd::Zero(state.dimension(), 3);
  G.middleRows<3>(State::kPosition).setIdentity();
  for (int i = 0; i < static_cast<int>(state.clones().size()); ++i) {
    G.middleRows<3>(state.clone_offset(i)).setIdentity();
  }
  std::mt19937 generator(1);
  std::uniform_real_distribution<double> decade(-3, -0.5), step(-0.02, 0.02);
  int used = 0;
  for (int i = 0; i < 3000; ++i) {
    state.correct(Eigen::VectorXd::Zero(state.dimension()), G,
                  -0.03 * 0.03 * Eigen::Matrix3d::Identity());
    const Peer peer{std::pow(10, decade(generator)),
                    {step(generator), step(generator), step(generator)}};
    used += update_from_peer(state, keyframe_of(state, {}, vision, peer), kGate).used > 0 ? 1 : 0;
    if (i % 50 == 0) {
      ASSERT_TRUE(positive(state)) << "after " << i;
    }
  }
  EXPECT_GT(used, 1000);
  EXPECT_TRUE(positive(state));
}

}  // namespace
}  // namespace covey
