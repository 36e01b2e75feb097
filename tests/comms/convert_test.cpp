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
  EXPECT_EQ(got.descriptor, sent.descriptor);
}

TEST(Convert, KeyframeSurvivesTheWireToFloatPrecision) {
  const PeerKeyframe sent = samples::keyframe();
  const auto decoded = decode_peer_keyframe(encode(sent));
  const PeerKeyframe& got = accepted(decoded);
  EXPECT_EQ(got.sender, sent.sender);
  EXPECT_EQ(got.receiver, sent.receiver);
  EXPECT_EQ(got.request_keyframe_id, sent.request_keyframe_id);
  EXPECT_EQ(got.keyframe_id, sent.keyframe_id);
  EXPECT_EQ(got.stamp_ns, sent.stamp_ns);
  ASSERT_EQ(got.landmarks.size(), sent.landmarks.size());
  for (std::size_t i = 0; i < sent.landmarks.size(); ++i) {
    const PeerLandmark &a = sent.landmarks[i], &b = got.landmarks[i];
    EXPECT_EQ(b.estimate.landmark_id, a.estimate.landmark_id);
    EXPECT_EQ(b.descriptor, a.descriptor);
    EXPECT_LT((b.bearing - a.bearing).norm(), 1e-7);
    EXPECT_LT((b.estimate.p_world - a.estimate.p_world).norm(), 1e-5);  // m, at 50 m
    EXPECT_LT((b.estimate.covariance - a.estimate.covariance).norm(),
              1e-6 * a.estimate.covariance.norm());
  }
}

TEST(Convert, StatusSurvivesTheWireUnchanged) {
  const StatusSample sent{samples::status(), {1, 0xffffffffffffffffULL, 3}};
  const auto decoded = decode_status(encode(sent));
  const StatusSample& got = accepted(decoded);
  EXPECT_EQ(got.status.agent, sent.status.agent);
  EXPECT_EQ(got.status.stamp_ns, sent.status.stamp_ns);
  EXPECT_EQ(got.status.status, sent.status.status);
  EXPECT_EQ(got.status.frames, sent.status.frames);
  EXPECT_EQ(got.status.tracks, sent.status.tracks);
  EXPECT_EQ(got.status.keyframes, sent.status.keyframes);
  EXPECT_EQ(got.hears, sent.hears);
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
  // 64 words of 32 bytes, the name, four numbers and CDR's own: the paper says 2.05 kB.
  EXPECT_EQ(encode(samples::advert()).size(), 2096u);
  const std::size_t with_40 = encode(samples::keyframe("uav1", "uav0", 40)).size();
  const std::size_t with_41 = encode(samples::keyframe("uav1", "uav0", 41)).size();
  EXPECT_EQ(with_41 - with_40, 88u);  // 84 and 4 bytes of alignment
  EXPECT_LT(with_40, 3600u);
}

TEST(Convert, TheLargestMessagesFitTheirLimits) {
  const std::string longest(kMaxNameLength, 'x');
  PlaceAdvert advert = samples::advert(longest);
  advert.descriptor.resize(kMaxDescriptorBytes);
  EXPECT_LE(encode(advert).size(), kMaxRequestBytes);
  EXPECT_LE(encode(samples::keyframe(longest, longest, kMaxLandmarks)).size(), kMaxMessageBytes);
  const StatusSample status{samples::status(longest), std::vector<std::uint64_t>(kMaxHears, 1)};
  EXPECT_LE(encode(status).size(), kMaxStatusBytes);
  EXPECT_LE(encode(OdometrySample{longest, samples::odometry()}).size(), kMaxOdometryBytes);
}

// Of `larger` against `smaller`, relative to the latter: at least 0 if larger is nowhere smaller.
double least_excess(const Eigen::Matrix3d& larger, const Eigen::Matrix3d& smaller) {
  const Eigen::Vector3d scale = smaller.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::Matrix3d difference = scale.asDiagonal() * (larger - smaller) * scale.asDiagonal();
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(difference).eigenvalues().minCoeff();
}

TEST(Convert, RoundingNeverMakesACovarianceSmaller) {
  std::mt19937 random(42);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> exponent(-3.0, 1.5);
  PeerKeyframe keyframe = samples::keyframe("uav1", "uav0", 200);
  for (int round = 0; round < 20; ++round) {
    for (PeerLandmark& landmark : keyframe.landmarks) {
      const Eigen::Matrix3d root = Eigen::Matrix3d::NullaryExpr([&] { return normal(random); });
      const Eigen::Vector3d sigma =
          Eigen::Vector3d::NullaryExpr([&] { return std::pow(10.0, exponent(random)); });
      const Eigen::Matrix3d q = Eigen::HouseholderQR<Eigen::Matrix3d>(root).householderQ();
      landmark.estimate.covariance = q * sigma.cwiseAbs2().asDiagonal() * q.transpose();
    }
    const auto decoded = decode_peer_keyframe(encode(keyframe));
    const PeerKeyframe& got = accepted(decoded);
    for (std::size_t i = 0; i < got.landmarks.size(); ++i) {
      const double excess = least_excess(got.landmarks[i].estimate.covariance,
                                         keyframe.landmarks[i].estimate.covariance);
      EXPECT_GE(excess, 0.0);
      EXPECT_LT(excess, 1e-6);
    }
  }
}

TEST(Convert, RoundingOfAFarPositionIsPaidForInItsCovariance) {
  PeerKeyframe keyframe = samples::keyframe("uav1", "uav0", 1);
  LandmarkEstimate& sent = keyframe.landmarks[0].estimate;
  sent.p_world = {99999.987654321, -12345.678987654, 0.1};  // a float there is 8 mm wide
  sent.covariance = 1e-8 * Eigen::Matrix3d::Identity();
  const auto decoded = decode_peer_keyframe(encode(keyframe));
  const LandmarkEstimate& got = accepted(decoded).landmarks[0].estimate;
  const Eigen::Vector3d error = got.p_world - sent.p_world;
  EXPECT_GT(error.norm(), 1e-4);  // or the test tests nothing
  const Eigen::Matrix3d needed = sent.covariance + error * error.transpose();
  EXPECT_GE(least_excess(got.covariance, needed), 0.0);
}

}  // namespace
}  // namespace covey
