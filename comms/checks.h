// SPDX-License-Identifier: Apache-2.0
//
// What a message must satisfy before anybody works with it. The sender asks the same questions as
// the receiver, so that a healthy drone never says what others would refuse.
#pragma once

#include <cstddef>
#include <optional>
#include <string>

#include "estimator/filter_snapshot.h"
#include "estimator/measurements.h"

namespace covey {

inline constexpr std::size_t kMaxNameLength = 32;
inline constexpr std::size_t kMaxDescriptorBytes = 4096;  // as in idl/covey.idl
inline constexpr std::size_t kMaxLandmarks = 256;         // as in idl/covey.idl
inline constexpr std::size_t kMaxHears = 64;              // as in idl/covey.idl
inline constexpr int kMaxFilterDimension = 256;  // error states: idl/covey.idl has room for no more

// Plausible magnitudes: far beyond what a drone does, near enough that arithmetic stays sane.
inline constexpr TimeNs kMaxStampNs = 4'000'000'000'000'000'000;  // differences cannot overflow
inline constexpr double kMaxBearing = 3.99;      // tangent: 76 degrees off the optical axis
inline constexpr double kMaxPatchSpacing = 0.1;  // normalised plane
inline constexpr double kMinInverseDepth = 1.0 / 65536, kMaxInverseDepth = 65535;  // 1/m
inline constexpr double kMaxLogDepthRatio = 10;
inline constexpr double kMaxPosition = 1e5;     // m
inline constexpr double kMaxSpeed = 200.0;      // m/s
inline constexpr double kMaxGyroBias = 10.0;    // rad/s
inline constexpr double kMaxAccelBias = 100.0;  // m/s2
inline constexpr double kMaxSigma = 1e4;        // m or rad
inline constexpr double kMaxViewSigma = 1e9;    // CameraView

// Not negative, and so that differences cannot overflow.
[[nodiscard]] bool is_stamp(TimeNs stamp_ns);

// 1..32 characters of [A-Za-z0-9_-]: also safe in topic and file names.
[[nodiscard]] bool is_agent_name(const std::string& name);

// Up to what rounding to float32 does to it. Not if any component is not finite.
[[nodiscard]] bool is_unit(const Eigen::Quaterniond& q);

// The first thing that is wrong, in words from a fixed set (they are counted); none if all is well.
using Problem = std::optional<std::string>;
[[nodiscard]] Problem problem_with(const PlaceAdvert& advert);
[[nodiscard]] Problem problem_with(const PeerKeyframe& keyframe);
[[nodiscard]] Problem problem_with(const FullPeerKeyframe& message);
[[nodiscard]] Problem problem_with(const AgentStatus& status);
[[nodiscard]] Problem problem_with(const Odometry& odometry);

}  // namespace covey
