// SPDX-License-Identifier: Apache-2.0
#include "comms/convert.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <random>

#include "comms/checks.h"
#include "tests/comms/samples.h"

namespace covey {
namespace {

template <typename T>
const T& accepted(const Decoded<T>& decoded) {
  if (const auto* rejected = std::get_if<Rejected>(&decoded))
    throw std::runtime_error("rejected: " + rejected->reason);
  return std::get<T>(decoded);
}

TEST(Convert, AdvertSurvivesTheWireUnchanged) {
  const PlaceAdvert sent = samples::advert();
  const auto decoded = decode_place_advert(encode(sent));
  const PlaceAdvert& got = accepted(decoded);
  EXPECT_EQ(got.sender, sent.sender);
  EXPECT_EQ(got.keyframe_id, sent.keyframe_id);
  EXPECT_EQ(got.stamp_ns, sent.stamp_ns);
  EXPECT_EQ(got.vocabulary_hash, sent.vocabulary_hash);
  EXPECT_TRUE(got.view.T_world_cam.isApprox(sent.view.T_world_cam, 1e-12));
  EXPECT_EQ(got.view.mean_depth, sent.view.mean_depth);
  EXPECT_EQ(got.view.sigma, sent.view.sigma);
  EXPECT_EQ(got.descriptor, sent.descriptor);
}

TEST(Convert, KeyframeSurvivesTheWire) {
  const PeerKeyframe sent = samples::keyframe();
  const auto decoded = decode_peer_keyframe(encode(sent));
  const PeerKeyframe& got = accepted(decoded);
  EXPECT_EQ(got.sender, sent.sender);
  EXPECT_EQ(got.receiver, sent.receiver);
  EXPECT_EQ(got.request_keyframe_id, sent.request_keyframe_id);
  EXPECT_EQ(got.pose.keyframe_id, sent.pose.keyframe_id);
  EXPECT_EQ(got.pose.stamp_ns, sent.pose.stamp_ns);
  EXPECT_EQ(got.pose.T_world_cam.translation(), sent.pose.T_world_cam.translation());
  EXPECT_LT((got.pose.T_world_cam.linear() - sent.pose.T_world_cam.linear()).norm(), 1e-6);
  EXPECT_LT((got.pose.covariance - sent.pose.covariance).norm(),
            1e-6 * sent.pose.covariance.norm());
  EXPECT_EQ(got.before.keyframe_id, sent.before.keyframe_id);
  EXPECT_EQ(got.before.T_world_cam.translation(), sent.before.T_world_cam.translation());
  EXPECT_EQ(got.patch_spacing, sent.patch_spacing);
  ASSERT_EQ(got.landmarks.size(), sent.landmarks.size());
  for (std::size_t i = 0; i < sent.landmarks.size(); ++i) {
    const PeerLandmark &a = sent.landmarks[i], &b = got.landmarks[i];
    EXPECT_EQ(b.descriptor, a.descriptor);
    EXPECT_EQ(b.bearing, a.bearing);
    EXPECT_EQ(b.inverse_depth, a.inverse_depth);
    EXPECT_EQ(b.inverse_depth_sigma, a.inverse_depth_sigma);
    EXPECT_EQ(b.patch, a.patch);
  }
}

TEST(Convert, TheSameKeyframeTwiceIsSentOnce) {
  PeerKeyframe message = samples::found();
  const std::size_t with_both = encode(message).size();
  message.before = message.pose;
  const Bytes told = encode(message);
  EXPECT_LT(told.size() + 135, with_both);
  const auto decoded = decode_peer_keyframe(told);
  const PeerKeyframe& got = accepted(decoded);
  EXPECT_EQ(got.before.keyframe_id, message.pose.keyframe_id);
  EXPECT_EQ(got.before.stamp_ns, message.pose.stamp_ns);
  EXPECT_EQ(got.before.T_world_cam.matrix(), got.pose.T_world_cam.matrix());
  EXPECT_EQ(got.before.covariance, got.pose.covariance);
}

// A question without corners, and an answer without descriptors: fewer bytes, nothing else.
TEST(Convert, WhatIsBriefSurvivesTheWire) {
  PlaceAdvert question = samples::advert();
  question.descriptor.clear();
  const Bytes asked = encode(question);
  EXPECT_LT(asked.size(), 120u);
  const auto decoded_question = decode_place_advert(asked);
  EXPECT_TRUE(accepted(decoded_question).descriptor.empty());

  PeerKeyframe answer = samples::keyframe();
  const std::size_t described_bytes = encode(answer).size();
  answer.described = false;
  const Bytes told = encode(answer);
  EXPECT_NEAR(static_cast<double>(described_bytes - told.size()),
              8.0 * static_cast<double>(answer.landmarks.size()), 8);
  const auto decoded = decode_peer_keyframe(told);
  const PeerKeyframe& got = accepted(decoded);
  EXPECT_FALSE(got.described);
  ASSERT_EQ(got.landmarks.size(), answer.landmarks.size());
  for (std::size_t i = 0; i < got.landmarks.size(); ++i) {
    EXPECT_EQ(got.landmarks[i].descriptor, ShortDescriptor{});
    EXPECT_EQ(got.landmarks[i].bearing, answer.landmarks[i].bearing);
    EXPECT_EQ(got.landmarks[i].inverse_depth, answer.landmarks[i].inverse_depth);
    EXPECT_EQ(got.landmarks[i].patch, answer.landmarks[i].patch);
  }
  const auto decoded_described = decode_peer_keyframe(encode(samples::keyframe()));
  const auto decoded_found = decode_peer_keyframe(encode(samples::found()));
  EXPECT_TRUE(accepted(decoded_described).described);
  EXPECT_TRUE(accepted(decoded_found).described) << "has no landmarks to describe";
}

TEST(Convert, WhatWasFoundSurvivesTheWire) {
  const PeerKeyframe sent = samples::found();
  const auto decoded = decode_peer_keyframe(encode(sent));
  const PeerKeyframe& got = accepted(decoded);
  EXPECT_EQ(got.receiver, sent.receiver);
  EXPECT_EQ(got.pose.keyframe_id, sent.pose.keyframe_id);
  EXPECT_TRUE(got.landmarks.empty());
  ASSERT_TRUE(got.found);
  EXPECT_EQ(got.found->keyframe_id, sent.found->keyframe_id);
  EXPECT_EQ(got.found->T_keyframe_cam.translation(), sent.found->T_keyframe_cam.translation());
  EXPECT_TRUE(got.found->T_keyframe_cam.isApprox(sent.found->T_keyframe_cam, 1e-6));
  EXPECT_EQ(got.found->log_depth_ratio, sent.found->log_depth_ratio);
  EXPECT_TRUE(got.found->covariance.isApprox(sent.found->covariance, 1e-6));
  EXPECT_FALSE(accepted(decode_peer_keyframe(encode(samples::keyframe()))).found);
}

// Bearings to a thirtieth of a pixel, depths to a fiftieth of a percent, their uncertainty never
// less than it was.
TEST(Convert, LandmarksAreRoundedFinely) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> tangent(-kMaxBearing, kMaxBearing), octave(-9, 9);
  PeerKeyframe sent = samples::keyframe("uav1", "uav0", 200);
  for (PeerLandmark& landmark : sent.landmarks) {
    landmark.bearing = {tangent(random), tangent(random)};
    landmark.inverse_depth = std::exp2(octave(random));
    landmark.inverse_depth_sigma = landmark.inverse_depth * std::exp2(octave(random) - 9);
  }
  const auto decoded = decode_peer_keyframe(encode(sent));
  const PeerKeyframe& got = accepted(decoded);
  for (std::size_t i = 0; i < sent.landmarks.size(); ++i) {
    const PeerLandmark &a = sent.landmarks[i], &b = got.landmarks[i];
    EXPECT_LT((b.bearing - a.bearing).cwiseAbs().maxCoeff(), 6.2e-5);
    EXPECT_NEAR(b.inverse_depth / a.inverse_depth, 1.0, 1.8e-4);
    const double share = a.inverse_depth_sigma / a.inverse_depth;
    const double got_share = b.inverse_depth_sigma / b.inverse_depth;
    EXPECT_GE(got_share, share * (1 - 1e-9));
    EXPECT_LE(got_share, std::max(5.5e-4, 1.1 * share));
  }
}

// Between the processes of a drone and its link messages are encoded twice.
TEST(Convert, LandmarksAreRoundedOnlyOnce) {
  std::mt19937 random(8);
  std::uniform_real_distribution<double> octave(-9, 9);
  PeerKeyframe sent = samples::keyframe("uav1", "uav0", 200);
  for (PeerLandmark& landmark : sent.landmarks) {
    landmark.inverse_depth = std::exp2(octave(random));
    landmark.inverse_depth_sigma = landmark.inverse_depth * std::exp2(octave(random) - 9);
  }
  const auto once = decode_peer_keyframe(encode(sent));
  const auto twice = decode_peer_keyframe(encode(accepted(once)));
  for (std::size_t i = 0; i < sent.landmarks.size(); ++i) {
    const PeerLandmark &a = accepted(once).landmarks[i], &b = accepted(twice).landmarks[i];
    EXPECT_EQ(a.bearing, b.bearing);
    EXPECT_EQ(a.inverse_depth, b.inverse_depth);
    EXPECT_EQ(a.inverse_depth_sigma, b.inverse_depth_sigma);
  }
}

TEST(Convert, AWholeFilterSurvivesTheWireUnchanged) {
  const FullPeerKeyframe sent = samples::full_keyframe("uav1", "");
  const auto decoded = decode_full_keyframe(encode(sent));
  const FullPeerKeyframe& got = accepted(decoded);
  EXPECT_EQ(got.keyframe.sender, sent.keyframe.sender);
  EXPECT_EQ(got.keyframe.receiver, "");
  EXPECT_EQ(got.keyframe.landmarks.size(), sent.keyframe.landmarks.size());
  EXPECT_EQ(got.filter.stamp_ns, sent.filter.stamp_ns);
  EXPECT_EQ(got.filter.state, sent.filter.state);
  EXPECT_EQ(got.filter.landmark_tracks, sent.filter.landmark_tracks);
  EXPECT_EQ(got.filter.landmark_anchors, sent.filter.landmark_anchors);
  EXPECT_EQ(got.filter.covariance, sent.filter.covariance);
}

TEST(Convert, StatusSurvivesTheWireUnchanged) {
  const StatusSample sent{
      samples::status(), {{1, 0, 0}, {~0ULL, 1'700'000'000, kMaxStampNs}}, kMaxStampNs};
  const auto decoded = decode_status(encode(sent));
  const StatusSample& got = accepted(decoded);
  EXPECT_EQ(got.status.agent, sent.status.agent);
  EXPECT_EQ(got.status.stamp_ns, sent.status.stamp_ns);
  EXPECT_EQ(got.status.status, sent.status.status);
  EXPECT_EQ(got.status.frames, sent.status.frames);
  EXPECT_EQ(got.status.tracks, sent.status.tracks);
  EXPECT_EQ(got.status.keyframes, sent.status.keyframes);
  EXPECT_EQ(got.sent_ns, sent.sent_ns);
  ASSERT_EQ(got.hears.size(), sent.hears.size());
  for (std::size_t i = 0; i < sent.hears.size(); ++i) {
    EXPECT_EQ(got.hears[i].token, sent.hears[i].token);
    EXPECT_EQ(got.hears[i].sent_ns, sent.hears[i].sent_ns);
    EXPECT_EQ(got.hears[i].received_ns, sent.hears[i].received_ns);
  }
}

TEST(Convert, OdometrySurvivesTheWire) {
  const Odometry sent = samples::odometry();
  const auto decoded = decode_odometry(encode(OdometrySample{"uav0", sent}));
  const OdometrySample& got = accepted(decoded);
  EXPECT_EQ(got.agent, "uav0");
  EXPECT_EQ(got.odometry.stamp_ns, sent.stamp_ns);
  EXPECT_EQ(got.odometry.status, sent.status);
  EXPECT_EQ(got.odometry.pose.p_world_imu, sent.pose.p_world_imu);
  EXPECT_LT(got.odometry.pose.q_world_imu.angularDistance(sent.pose.q_world_imu), 1e-9);
  EXPECT_EQ(got.odometry.v_world_imu, sent.v_world_imu);
  EXPECT_EQ(got.odometry.gyro_bias, sent.gyro_bias);
  EXPECT_EQ(got.odometry.accel_bias, sent.accel_bias);
  EXPECT_LT((got.odometry.pose_covariance - sent.pose_covariance).norm(), 1e-8);
}

TEST(Convert, SizesAreWhatTheMethodCountsWith) {
  // 64 words of 32 bytes, the name, four numbers, a view and CDR's own: the paper says 2.05 kB.
  EXPECT_EQ(encode(samples::advert()).size(), 2132u);
  const std::size_t with_40 = encode(samples::keyframe("uav1", "uav0", 40)).size();
  const std::size_t with_80 = encode(samples::keyframe("uav1", "uav0", 80)).size();
  EXPECT_EQ(with_80 - with_40, 40u * 23u);
  EXPECT_LT(with_40, 1300u);
  EXPECT_LT(encode(samples::found()).size(), 520u);
  PeerKeyframe without_patches = samples::keyframe("uav1", "uav0", 40);
  without_patches.patch_spacing = 0;
  EXPECT_EQ(encode(without_patches).size() + 40u * 8u, with_40);
  // The paper's filter of about 150 states: 190.7 kB, most of it 180 kB of covariance.
  FullPeerKeyframe full = samples::full_keyframe();
  full.filter = samples::filter(10, 25);
  ASSERT_EQ(full.filter.covariance.rows(), 150);
  EXPECT_NEAR(static_cast<double>(encode(full).size()), 180e3 + 3e3, 0.5e3);
}

TEST(Convert, TheLargestMessagesFitTheirLimits) {
  const std::string longest(kMaxNameLength, 'x');
  PlaceAdvert advert = samples::advert(longest);
  advert.descriptor.resize(kMaxDescriptorBytes);
  EXPECT_LE(encode(advert).size(), kMaxRequestBytes);
  EXPECT_LE(encode(samples::keyframe(longest, longest, kMaxLandmarks)).size(), kMaxMessageBytes);
  FullPeerKeyframe full{samples::keyframe(longest, longest, kMaxLandmarks), samples::filter(1, 78)};
  ASSERT_EQ(full.filter.covariance.rows(), kMaxFilterDimension - 1);
  EXPECT_LE(encode(full).size(), kMaxFullMessageBytes);
  full.filter = samples::filter(40, 0);
  ASSERT_EQ(full.filter.covariance.rows(), kMaxFilterDimension - 1);
  EXPECT_LE(encode(full).size(), kMaxFullMessageBytes);
  const StatusSample status{samples::status(longest), std::vector<HeardPeer>(kMaxHears)};
  EXPECT_LE(encode(status).size(), kMaxStatusBytes);
  EXPECT_LE(encode(OdometrySample{longest, samples::odometry()}).size(), kMaxOdometryBytes);
}

TEST(Convert, RoundingNeverMakesACovarianceSmaller) {
  std::mt19937 random(42);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> exponent(-3.0, 1.5);
  PeerKeyframe keyframe = samples::keyframe("uav1", "uav0", 1);
  for (int round = 0; round < 500; ++round) {
    const Matrix6d root = Matrix6d::NullaryExpr([&] { return normal(random); });
    const Eigen::Matrix<double, 6, 1> sigma =
        Eigen::Matrix<double, 6, 1>::NullaryExpr([&] { return std::pow(10.0, exponent(random)); });
    const Matrix6d q = Eigen::HouseholderQR<Matrix6d>(root).householderQ();
    const Matrix6d sent = q * sigma.cwiseAbs2().asDiagonal() * q.transpose();
    keyframe.pose.covariance = sent;
    const auto decoded = decode_peer_keyframe(encode(keyframe));
    const Matrix6d& got = accepted(decoded).pose.covariance;
    const auto scale = sent.diagonal().cwiseSqrt().cwiseInverse().asDiagonal();
    const Matrix6d difference = scale * (got - sent) * scale;
    const double excess =
        Eigen::SelfAdjointEigenSolver<Matrix6d>(difference).eigenvalues().minCoeff();
    EXPECT_GE(excess, 0.0);
    EXPECT_LT(excess, 1e-6);
  }
}

}  // namespace
}  // namespace covey
