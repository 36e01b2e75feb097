// SPDX-License-Identifier: Apache-2.0
//
// Well-formed messages for the tests to send, compare and break.
#pragma once

#include <cmath>
#include <numeric>
#include <string>

#include "comms/convert.h"
#include "estimator/measurements.h"

namespace covey::samples {

inline PlaceAdvert advert(const std::string& sender = "uav0", std::uint64_t keyframe_id = 7) {
  PlaceAdvert out;
  out.sender = sender;
  out.keyframe_id = keyframe_id;
  out.stamp_ns = 1'403'715'273'262'142'976;  // EuRoC MH_01's first image
  out.vocabulary_hash = 0x0123456789abcdefULL;
  out.view.T_world_cam.linear() = Eigen::Quaterniond(0.5, 0.5, -0.5, 0.5).toRotationMatrix();
  out.view.T_world_cam.translation() << 1.5, -22.25, 3;
  out.view.mean_depth = 12.5;
  out.view.sigma = 0.25;
  out.descriptor.resize(2048);
  std::iota(out.descriptor.begin(), out.descriptor.end(), std::uint8_t{0});
  return out;
}

// One of many; no two are alike, and all survive the wire's rounding unchanged.
inline PeerLandmark landmark(std::uint64_t number) {
  PeerLandmark out;
  out.descriptor.fill(static_cast<std::uint8_t>(number));
  out.bearing = {0.25, -0.125 * static_cast<double>(number % 7)};
  out.inverse_depth = 0.125;                          // 8 m
  out.inverse_depth_sigma = 0.125 * std::exp2(-4.0);  // 6 %
  out.patch.fill(static_cast<std::uint8_t>(7 * number));
  return out;
}

inline KeyframePose keyframe_pose(std::uint64_t id = 12) {
  KeyframePose out;
  out.keyframe_id = id;
  out.stamp_ns = 1'403'715'273'362'142'976;
  out.T_world_cam.linear() =
      Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix();
  out.T_world_cam.translation() = Eigen::Vector3d(10.1, -20.2, 3.3);
  out.covariance = 1e-4 * Matrix6d::Identity() + Matrix6d::Constant(1e-5);
  return out;
}

inline PeerKeyframe keyframe(const std::string& sender = "uav1",
                             const std::string& receiver = "uav0", std::size_t landmarks = 40) {
  PeerKeyframe out;
  out.sender = sender;
  out.receiver = receiver;
  out.request_keyframe_id = 7;
  out.pose = keyframe_pose();
  out.before = keyframe_pose(9);
  out.patch_spacing = 0.0625 / 16;
  for (std::size_t i = 0; i < landmarks; ++i) out.landmarks.push_back(landmark(100 + i));
  return out;
}

// What came of an answer, back to who gave it.
inline PeerKeyframe found(const std::string& sender = "uav1",
                          const std::string& receiver = "uav0") {
  PeerKeyframe out = keyframe(sender, receiver, 0);
  FoundKeyframe& found = out.found.emplace();
  found.keyframe_id = 31;
  found.T_keyframe_cam.linear() =
      Eigen::AngleAxisd(-0.3, Eigen::Vector3d(2, 1, 0).normalized()).toRotationMatrix();
  found.T_keyframe_cam.translation() = Eigen::Vector3d(0.5, -1.25, 2);
  found.log_depth_ratio = 0.0078125;
  found.covariance = 1e-5 * Matrix7d::Identity() + Matrix7d::Constant(1e-6);
  return out;
}

// Of a filter whose calibration is not estimated.
inline FilterSnapshot filter(Eigen::Index clones = 3, Eigen::Index landmarks = 2) {
  FilterSnapshot out;
  out.stamp_ns = 1'403'715'273'362'142'976;
  out.state = Eigen::VectorXd::LinSpaced(24 + 7 * clones + 3 * landmarks, -0.5, 0.5);
  const Eigen::Vector4d turned(0.1, -0.7, 0.1, 0.7);
  out.state.segment<4>(6) = out.state.segment<4>(19) = turned;
  for (Eigen::Index i = 0; i < clones; ++i) out.state.segment<4>(24 + 7 * i + 3) = turned;
  for (Eigen::Index i = 0; i < landmarks; ++i) {
    out.landmark_tracks.push_back(1'000'000'000'000 + static_cast<std::uint64_t>(i));
    out.landmark_anchors.push_back(static_cast<std::uint8_t>(i % clones));
  }
  const Eigen::Index rows = 15 + 6 * clones + 3 * landmarks;
  out.covariance = Eigen::MatrixXd::Constant(rows, rows, 1e-5);
  out.covariance.diagonal() = Eigen::VectorXd::LinSpaced(rows, 1e-4, 1.0 / 3);
  return out;
}

inline FullPeerKeyframe full_keyframe(const std::string& sender = "uav1",
                                      const std::string& receiver = "uav0") {
  return {keyframe(sender, receiver), filter()};
}

inline AgentStatus status(const std::string& agent = "uav0", std::uint32_t frames = 30) {
  AgentStatus out;
  out.agent = agent;
  out.stamp_ns = 1'000'000'000;
  out.status = FilterStatus::kTracking;
  out.frames = frames;
  out.tracks = 180;
  out.keyframes = 4;
  return out;
}

inline Odometry odometry() {
  Odometry out;
  out.stamp_ns = 2'000'000'000;
  out.status = FilterStatus::kTracking;
  out.pose.p_world_imu = {1.5, -2.5, 3.5};
  out.pose.q_world_imu = Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized());
  out.v_world_imu = {0.1, 0.2, -0.3};
  out.gyro_bias = {0.01, -0.02, 0.03};
  out.accel_bias = {0.1, -0.2, 0.3};
  out.pose_covariance = 1e-3 * Matrix6d::Identity() + Matrix6d::Constant(1e-4);
  return out;
}

}  // namespace covey::samples
