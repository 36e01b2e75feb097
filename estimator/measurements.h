// SPDX-License-Identifier: Apache-2.0
//
// The plain structs that travel between rooms: Eigen and std only, values, no behaviour.
//
// Frames: `world` is z up, gravity (0, 0, -9.81) m/s2; `imu` is the body; `cam` is x right, y down,
// z forward. Transforms read x_a = T_a_b * x_b; p_a_b is the origin of b in a; quaternions are
// Hamilton and unit, v_a = q_a_b * v_b. SI units and radians. Stamps are nanoseconds on the IMU
// clock.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace covey {

using TimeNs = std::int64_t;

[[nodiscard]] inline double seconds_between(TimeNs from, TimeNs to) {
  return static_cast<double>(to - from) * 1e-9;
}
[[nodiscard]] inline TimeNs nanoseconds(double seconds) {
  return static_cast<TimeNs>(seconds * 1e9 + (seconds < 0 ? -0.5 : 0.5));
}

using Matrix6d = Eigen::Matrix<double, 6, 6>;

struct ImuSample {
  TimeNs stamp_ns = 0;
  Eigen::Vector3d gyro_imu = Eigen::Vector3d::Zero();   // angular rate, rad/s
  Eigen::Vector3d accel_imu = Eigen::Vector3d::Zero();  // specific force, m/s2 (+9.81 up at rest)
};

// One landmark seen in one image, on the normalised (z = 1), undistorted image plane.
struct TrackObservation {
  std::uint64_t track_id = 0;  // unique per drone, never used again after the track ended
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();  // (x/z, y/z) in cam
  double sigma = 1e-3;  // standard deviation of either component, same unit as `bearing`
};

// What is left of an image once the front-end is done with it.
struct CameraMeasurement {
  TimeNs stamp_ns = 0;
  std::vector<TrackObservation> tracks;
};

// Position and attitude of the IMU in the world.
struct Pose {
  Eigen::Vector3d p_world_imu = Eigen::Vector3d::Zero();
  Eigen::Quaterniond q_world_imu = Eigen::Quaterniond::Identity();
};

enum class FilterStatus : std::uint8_t {
  kUninitialized = 0,
  kTracking = 1,
  kDegraded = 2,
  kLost = 3
};

struct Odometry {
  TimeNs stamp_ns = 0;
  FilterStatus status = FilterStatus::kUninitialized;
  Pose pose;
  Eigen::Vector3d v_world_imu = Eigen::Vector3d::Zero();  // m/s
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();    // rad/s
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();   // m/s2
  // Of [dp dtheta]: dp in world, dtheta local: q = q_hat * Exp(dtheta).
  Matrix6d pose_covariance = Matrix6d::Zero();
};

// ----------------------------------------------------------------------------- between drones

using BinaryDescriptor = std::array<std::uint8_t, 32>;  // ORB, 256 bits

// A landmark of one drone as it stands: what both collaborative updates need (METHOD: {p_f,
// Sigma_f}).
struct LandmarkEstimate {
  std::uint64_t landmark_id = 0;                      // the track id at the drone that owns it
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();  // m
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Identity();  // m2, marginal, in world
};

// "I am here: has anybody seen this place?" (the paper's RequestUAV)
struct PlaceAdvert {
  std::string sender;
  std::uint64_t keyframe_id = 0;         // counts up per sender; the answer repeats it
  TimeNs stamp_ns = 0;                   // of the keyframe's image
  std::uint64_t vocabulary_hash = 0;     // words of another vocabulary mean nothing: refused
  std::vector<std::uint8_t> descriptor;  // of the place: binary VLAD or shortened corners
};

struct PeerLandmark {
  BinaryDescriptor descriptor{};
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();  // in the sender's keyframe, normalised plane
  LandmarkEstimate estimate;
};

// A keyframe of one drone, sent to the one that asked (the paper's MessageUAV).
struct PeerKeyframe {
  std::string sender;
  std::string receiver;
  std::uint64_t request_keyframe_id = 0;  // PlaceAdvert::keyframe_id that is answered
  std::uint64_t keyframe_id = 0;          // the sender's keyframe
  TimeNs stamp_ns = 0;                    // when the sender's keyframe was taken
  std::vector<PeerLandmark> landmarks;
};

struct AgentStatus {
  std::string agent;
  TimeNs stamp_ns = 0;
  FilterStatus status = FilterStatus::kUninitialized;
  std::uint32_t frames = 0;
  std::uint32_t tracks = 0;
  std::uint32_t keyframes = 0;
};

// Own track `track_id` and a peer's landmark are the same point of the scene.
struct LandmarkMatch {
  std::uint64_t track_id = 0;
  LandmarkEstimate peer;      // as the peer sent it
  double matching_sigma = 0;  // m, of each axis: how far the two corners may be apart; independent
                              // from match to match
};

struct PeerMatches {
  std::string peer;
  TimeNs stamp_ns = 0;  // of the own keyframe that was matched
  std::vector<LandmarkMatch> matches;
};

}  // namespace covey
