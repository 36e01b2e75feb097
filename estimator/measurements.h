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
#include <optional>
#include <string>
#include <vector>

#include "estimator/camera_view.h"

namespace covey {

using TimeNs = std::int64_t;

[[nodiscard]] inline double seconds_between(TimeNs from, TimeNs to) {
  return static_cast<double>(to - from) * 1e-9;
}
[[nodiscard]] inline TimeNs nanoseconds(double seconds) {
  return static_cast<TimeNs>(seconds * 1e9 + (seconds < 0 ? -0.5 : 0.5));
}

using Matrix6d = Eigen::Matrix<double, 6, 6>;
using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Vector7d = Eigen::Matrix<double, 7, 1>;

// By how much a camera's intrinsics differ from what bearings are computed with:
// [dfx/fx dfy/fy dcx/fx dcy/fy dk1 dk2], k1 and k2 as the lens model has them; and what that does
// to a bearing.
constexpr int kIntrinsicsSize = 6;
using IntrinsicsError = Eigen::Matrix<double, kIntrinsicsSize, 1>;
using BearingByIntrinsics = Eigen::Matrix<double, 2, kIntrinsicsSize>;

struct ImuSample {
  TimeNs stamp_ns = 0;
  Eigen::Vector3d gyro_imu = Eigen::Vector3d::Zero();   // angular rate, rad/s
  Eigen::Vector3d accel_imu = Eigen::Vector3d::Zero();  // specific force, m/s2 (+9.81 up at rest)
};

// One landmark seen in one image, on the normalised (z = 1), undistorted image plane.
struct TrackObservation {
  std::uint64_t track_id = 0;  // unique per drone, never used again after the track ended
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();                // (x/z, y/z) in cam
  Eigen::Matrix2d covariance = 1e-6 * Eigen::Matrix2d::Identity();  // of `bearing`
  // How wrong it is by wrong intrinsics: by_intrinsics * IntrinsicsError, true values minus those
  // with which `bearing` was computed. Zero: they are right.
  BearingByIntrinsics by_intrinsics = BearingByIntrinsics::Zero();
};

// What is left of an image once the front-end is done with it.
struct CameraMeasurement {
  TimeNs stamp_ns = 0;
  std::vector<TrackObservation> tracks;  // one each; of two with the same id the first counts
};

// Position and attitude of the IMU in the world.
struct Pose {
  Eigen::Vector3d p_world_imu = Eigen::Vector3d::Zero();  // m
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
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();    // rad/s, in imu
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();   // m/s2, in imu
  // Of [dp dtheta]: dp in world, dtheta local: q = q_hat * Exp(dtheta).
  Matrix6d pose_covariance = Matrix6d::Zero();
  Eigen::Matrix3d velocity_covariance = Eigen::Matrix3d::Zero();  // of v_world_imu
};

// ----------------------------------------------------------------------------- between drones

using BinaryDescriptor = std::array<std::uint8_t, 32>;  // ORB, 256 bits
// Its first quarter: ORB's tests are sorted, those that tell most come first (Rublee et al. 2011).
// With the geometry to check them, drones match by it as well as by the whole.
using ShortDescriptor = std::array<std::uint8_t, 8>;

// What a corner looks like: 12 coefficients, 4 of 6 bits and then 8 of 5, two's complement, of the
// cosine transform of 8 x 8 grey levels (frontend/landmark_patch.h), one after the other, low bits
// first. All zero: none.
using LandmarkPatch = std::array<std::uint8_t, 8>;

// How far away a tracked corner is, seen from the newest image.
struct TrackDepth {
  std::uint64_t track_id = 0;
  double inverse_depth = 0;        // 1/z in cam, 1/m
  double inverse_depth_sigma = 0;  // 1/m, given the camera's pose
};

// The camera at a keyframe as its drone's own odometry has it, without any peer's help: that is
// what makes the errors of two drones independent.
struct KeyframePose {
  std::uint64_t keyframe_id = 0;  // counts up per drone
  TimeNs stamp_ns = 0;
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();  // in the drone's own world
  Matrix6d covariance = Matrix6d::Identity();  // of [dp dtheta], both in world: R = Exp(dtheta) R^
};

// Can both keyframes be of one flight of a drone? There, ids rise with time. A drone that starts
// anew counts from the beginning again, and nothing that it said in its earlier flight holds any
// more. For anything that has a keyframe_id and a stamp_ns.
template <typename A, typename B>
[[nodiscard]] bool are_of_one_flight(const A& a, const B& b) {
  return (a.keyframe_id < b.keyframe_id) == (a.stamp_ns < b.stamp_ns) &&
         (a.keyframe_id > b.keyframe_id) == (a.stamp_ns > b.stamp_ns);
}

// "I am here: has anybody seen this place?" (the paper's RequestUAV)
struct PlaceAdvert {
  std::string sender;
  std::uint64_t keyframe_id = 0;      // counts up per sender; the answer repeats it
  TimeNs stamp_ns = 0;                // of the keyframe's image
  std::uint64_t vocabulary_hash = 0;  // words of another vocabulary mean nothing: refused
  CameraView view;                    // in the sender's world: for choosing an answer, no more
  // Of the place: binary VLAD or shortened corners. Empty in a brief question, for those who know
  // where the sender is.
  std::vector<std::uint8_t> descriptor;
};

// A landmark in the camera of the keyframe that saw it.
struct PeerLandmark {
  ShortDescriptor descriptor{};
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();  // (x/z, y/z)
  double inverse_depth = 0;                           // 1/m
  double inverse_depth_sigma = 0;                     // 1/m, given the keyframe's pose
  LandmarkPatch patch{};
};

// Where a camera stood, seen from a keyframe of another drone whose landmarks it has found.
struct FoundKeyframe {
  std::uint64_t keyframe_id = 0;                                     // of the other drone
  Eigen::Isometry3d T_keyframe_cam = Eigen::Isometry3d::Identity();  // camera to camera
  double log_depth_ratio = 0;  // of the keyframe's depths to those that the camera's drone measured
  // Of [dp dtheta], both in the keyframe's axes, R = Exp(dtheta) R^, and of the log ratio.
  Matrix7d covariance = Matrix7d::Identity();
};

// A keyframe of one drone for another: an answer to the one that asked (the paper's MessageUAV), or
// back to the one that has answered, what came of it. Pose, its covariance and the landmarks'
// depths are nearly the joint covariance of all landmarks.
struct PeerKeyframe {
  std::string sender;
  std::string receiver;
  std::uint64_t request_keyframe_id = 0;  // PlaceAdvert::keyframe_id that is answered
  KeyframePose pose;                      // in the sender's world
  KeyframePose before;  // the other end of the way on which depths were measured; `pose`: on none
  double patch_spacing = 0;  // between the samples of the patches, normalised plane
  // Of an answer. One to a brief question has no descriptors: what landmarks look like is looked
  // for where they must be.
  bool described = true;
  std::vector<PeerLandmark> landmarks;
  // Back to who has answered: what `pose` has found of the receiver's keyframe.
  std::optional<FoundKeyframe> found;
};

// Own track `track_id` and a landmark of another keyframe are the same point of the scene.
struct LandmarkMatch {
  std::uint64_t track_id = 0;
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();        // in the own keyframe
  Eigen::Vector2d other_bearing = Eigen::Vector2d::Zero();  // in the other keyframe
  double inverse_depth = 0;                                 // 1/m, there
  double inverse_depth_sigma = 0;                           // 1/m
  // 1/m, in the own keyframe as the own drone has measured it; 0: it has not.
  double own_inverse_depth = 0, own_inverse_depth_sigma = 0;
  // To which `bearing` is the point that the other one means, normalised plane.
  Eigen::Matrix2d bearing_covariance = Eigen::Matrix2d::Zero();
};

// An own keyframe and another one, of a peer or an older one of the own, that see the same points.
struct KeyframeMatch {
  std::string drone;                                              // whose keyframe the other one is
  KeyframePose own, own_before;                                   // as in PeerKeyframe
  double own_mean_depth = 1;                                      // m, of what the own one sees
  KeyframePose other, other_before;                               // in that drone's world
  Eigen::Isometry3d T_other_own = Eigen::Isometry3d::Identity();  // camera to camera, roughly
  std::vector<LandmarkMatch> matches;                             // corners that both track
  // The other's landmarks found in the own image by what they look like, whether they are tracked
  // (else track_id is 0) or not; none where there are no patches.
  std::vector<LandmarkMatch> aligned;
};

struct AgentStatus {
  std::string agent;
  TimeNs stamp_ns = 0;
  FilterStatus status = FilterStatus::kUninitialized;
  std::uint32_t frames = 0;
  std::uint32_t tracks = 0;
  std::uint32_t keyframes = 0;
};

}  // namespace covey
