// SPDX-License-Identifier: Apache-2.0
#include "comms/convert.h"

#include <fastcdr/Cdr.h>
#include <fastcdr/FastBuffer.h>

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <exception>
#include <limits>

#include "comms/checks.h"
#include "idl/covey.h"

namespace covey {
namespace {

using eprosima::fastcdr::Cdr;
using eprosima::fastcdr::FastBuffer;

constexpr std::size_t kHeaderBytes = 4;      // CDR encapsulation
constexpr std::size_t kMaxPaddingBytes = 3;  // DDS pads a sample to a multiple of four

// ----------------------------------------------------------------------------- wire type <-> bytes

template <typename Wire>
Bytes serialize(const Wire& wire) {
  Bytes bytes(kHeaderBytes + Wire::getCdrSerializedSize(wire));
  FastBuffer buffer(reinterpret_cast<char*>(bytes.data()), bytes.size());
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  cdr.serialize_encapsulation();
  wire.serialize(cdr);
  bytes.resize(cdr.getSerializedDataLength());
  return bytes;
}

// Size, encapsulation and version: what can be told without trusting a single length field.
Problem problem_with_frame(const Bytes& bytes, std::size_t max_bytes) {
  if (bytes.size() > max_bytes) return "sample too large";
  if (bytes.size() <= kHeaderBytes) return "sample too short";
  // CDR_BE is 0 0, CDR_LE is 0 1; what follows are options that nobody uses.
  if (bytes[0] != 0 || bytes[1] > 1) return "unknown encapsulation";
  if (bytes[kHeaderBytes] != kWireVersion) return "another version of the messages";
  return {};
}

template <typename Wire>
Decoded<Wire> deserialize(const Bytes& bytes, std::size_t max_bytes) {
  if (const Problem problem = problem_with_frame(bytes, max_bytes)) return Rejected{*problem};
  // FastBuffer knows no const; deserialising does not write.
  FastBuffer buffer(reinterpret_cast<char*>(const_cast<std::uint8_t*>(bytes.data())), bytes.size());
  Cdr cdr(buffer, Cdr::DEFAULT_ENDIAN, Cdr::DDS_CDR);
  Wire wire;
  try {
    cdr.read_encapsulation();
    wire.deserialize(cdr);
  } catch (const std::exception&) {
    return Rejected{"sample ends too early"};
  }
  if (bytes.size() - cdr.getSerializedDataLength() > kMaxPaddingBytes)
    return Rejected{"sample has bytes left over"};
  return wire;
}

// ----------------------------------------------------------------------------- Quantisation
//
// float32 rounds x by at most u |x|, u = 2^-24. Off the diagonal |E_ij| <= u |P_ij| <= u s_i s_j,
// so E + (N-1) u diag(P) is positive semi-definite (Gershgorin, after scaling by s). A diagonal of
// (1 + N u) P_ii, rounded upwards, therefore gives a covariance that is never smaller than the
// original. A rounded position errs by e with |e_i| <= u |p_i|, and e e^T <= 3 diag(e_i^2).
// A rounded bearing errs by 6e-7 at most, a thousandth of its noise: not accounted for.

constexpr double kUnitRoundoff = 1.0 / (1 << 24);

float round_up(double value) {
  const auto rounded = static_cast<float>(value);
  if (rounded >= value) return rounded;
  return std::nextafter(rounded, std::numeric_limits<float>::infinity());
}

template <int N>
using Triangle = std::array<float, N*(N + 1) / 2>;

template <int N>
Triangle<N> upper_triangle(const Eigen::Matrix<double, N, N>& covariance) {
  Triangle<N> out{};
  std::size_t k = 0;
  for (int row = 0; row < N; ++row) {
    out[k++] = round_up((1.0 + N * kUnitRoundoff) * covariance(row, row));
    for (int col = row + 1; col < N; ++col) out[k++] = static_cast<float>(covariance(row, col));
  }
  return out;
}

template <int N>
Eigen::Matrix<double, N, N> symmetric(const Triangle<N>& triangle) {
  Eigen::Matrix<double, N, N> out;
  std::size_t k = 0;
  for (int row = 0; row < N; ++row)
    for (int col = row; col < N; ++col) out(row, col) = out(col, row) = triangle[k++];
  return out;
}

// ----------------------------------------------------------------------------- plain <-> wire type

template <typename Scalar, int N>
std::array<Scalar, static_cast<std::size_t>(N)> to_array(
    const Eigen::Matrix<double, N, 1>& vector) {
  std::array<Scalar, static_cast<std::size_t>(N)> out{};
  for (int i = 0; i < N; ++i) out[static_cast<std::size_t>(i)] = static_cast<Scalar>(vector[i]);
  return out;
}

template <typename Scalar, std::size_t N>
Eigen::Matrix<double, static_cast<int>(N), 1> to_vector(const std::array<Scalar, N>& values) {
  return Eigen::Map<const Eigen::Matrix<Scalar, static_cast<int>(N), 1>>(values.data())
      .template cast<double>();
}

wire::Landmark to_wire(const PeerLandmark& landmark) {
  wire::Landmark out;
  out.id(landmark.estimate.landmark_id);
  out.descriptor(landmark.descriptor);
  out.bearing(to_array<float, 2>(landmark.bearing));
  const Eigen::Vector3d& p_world = landmark.estimate.p_world;
  out.p_world(to_array<float, 3>(p_world));
  Eigen::Matrix3d covariance = landmark.estimate.covariance;
  covariance.diagonal() += 3.0 * (kUnitRoundoff * p_world).cwiseAbs2();
  out.covariance(upper_triangle<3>(covariance));
  return out;
}

PeerLandmark from_wire(const wire::Landmark& landmark) {
  PeerLandmark out;
  out.descriptor = landmark.descriptor();
  out.bearing = to_vector(landmark.bearing());
  out.estimate.landmark_id = landmark.id();
  out.estimate.p_world = to_vector(landmark.p_world());
  out.estimate.covariance = symmetric<3>(landmark.covariance());
  return out;
}

PlaceAdvert from_wire(const wire::RequestUAV& request) {
  PlaceAdvert out;
  out.sender = request.sender().to_string();
  out.keyframe_id = request.keyframe_id();
  out.stamp_ns = request.stamp_ns();
  out.vocabulary_hash = request.vocabulary_hash();
  out.descriptor = request.descriptor();
  return out;
}

PeerKeyframe from_wire(const wire::MessageUAV& message) {
  PeerKeyframe out;
  out.sender = message.sender().to_string();
  out.receiver = message.receiver().to_string();
  out.request_keyframe_id = message.request_keyframe_id();
  out.keyframe_id = message.keyframe_id();
  out.stamp_ns = message.stamp_ns();
  out.landmarks.reserve(message.landmarks().size());
  for (const wire::Landmark& landmark : message.landmarks())
    out.landmarks.push_back(from_wire(landmark));
  return out;
}

StatusSample from_wire(const wire::AgentStatus& status) {
  StatusSample out;
  out.status.agent = status.agent().to_string();
  out.status.stamp_ns = status.stamp_ns();
  out.status.status = static_cast<FilterStatus>(status.filter_status());
  out.status.frames = status.frames();
  out.status.tracks = status.tracks();
  out.status.keyframes = status.keyframes();
  out.hears = status.hears();
  return out;
}

OdometrySample from_wire(const wire::Odometry& odometry) {
  OdometrySample out;
  out.agent = odometry.agent().to_string();
  out.odometry.stamp_ns = odometry.stamp_ns();
  out.odometry.status = static_cast<FilterStatus>(odometry.filter_status());
  out.odometry.pose.p_world_imu = to_vector(odometry.p_world_imu());
  out.odometry.pose.q_world_imu.coeffs() = to_vector(odometry.q_world_imu_xyzw());
  out.odometry.v_world_imu = to_vector(odometry.v_world_imu());
  out.odometry.gyro_bias = to_vector(odometry.gyro_bias());
  out.odometry.accel_bias = to_vector(odometry.accel_bias());
  out.odometry.pose_covariance = symmetric<6>(odometry.pose_covariance());
  return out;
}

}  // namespace

// --------------------------------------------------------------------------------------- encode

Bytes encode(const PlaceAdvert& advert) {
  assert(!problem_with(advert));
  wire::RequestUAV out;
  out.version(kWireVersion);
  out.sender(advert.sender);
  out.keyframe_id(advert.keyframe_id);
  out.stamp_ns(advert.stamp_ns);
  out.vocabulary_hash(advert.vocabulary_hash);
  out.descriptor(advert.descriptor);
  return serialize(out);
}

Bytes encode(const PeerKeyframe& keyframe) {
  assert(!problem_with(keyframe));
  wire::MessageUAV out;
  out.version(kWireVersion);
  out.sender(keyframe.sender);
  out.receiver(keyframe.receiver);
  out.request_keyframe_id(keyframe.request_keyframe_id);
  out.keyframe_id(keyframe.keyframe_id);
  out.stamp_ns(keyframe.stamp_ns);
  out.landmarks().reserve(keyframe.landmarks.size());
  for (const PeerLandmark& landmark : keyframe.landmarks)
    out.landmarks().push_back(to_wire(landmark));
  return serialize(out);
}

Bytes encode(const StatusSample& sample) {
  assert(!problem_with(sample.status) && sample.hears.size() <= kMaxHears);
  wire::AgentStatus out;
  out.version(kWireVersion);
  out.agent(sample.status.agent);
  out.stamp_ns(sample.status.stamp_ns);
  out.filter_status(static_cast<std::uint8_t>(sample.status.status));
  out.frames(sample.status.frames);
  out.tracks(sample.status.tracks);
  out.keyframes(sample.status.keyframes);
  out.hears(sample.hears);
  return serialize(out);
}

Bytes encode(const OdometrySample& sample) {
  assert(is_agent_name(sample.agent) && !problem_with(sample.odometry));
  const Odometry& odometry = sample.odometry;
  wire::Odometry out;
  out.version(kWireVersion);
  out.agent(sample.agent);
  out.stamp_ns(odometry.stamp_ns);
  out.filter_status(static_cast<std::uint8_t>(odometry.status));
  out.p_world_imu(to_array<double, 3>(odometry.pose.p_world_imu));
  out.q_world_imu_xyzw(to_array<double, 4>(odometry.pose.q_world_imu.coeffs()));
  out.v_world_imu(to_array<double, 3>(odometry.v_world_imu));
  out.gyro_bias(to_array<double, 3>(odometry.gyro_bias));
  out.accel_bias(to_array<double, 3>(odometry.accel_bias));
  out.pose_covariance(upper_triangle<6>(odometry.pose_covariance));
  return serialize(out);
}

// --------------------------------------------------------------------------------------- decode

Decoded<PlaceAdvert> decode_place_advert(const Bytes& bytes) {
  const auto wire = deserialize<wire::RequestUAV>(bytes, kMaxRequestBytes);
  if (const auto* rejected = std::get_if<Rejected>(&wire)) return *rejected;
  PlaceAdvert advert = from_wire(std::get<wire::RequestUAV>(wire));
  if (const Problem problem = problem_with(advert)) return Rejected{*problem};
  return advert;
}

Decoded<PeerKeyframe> decode_peer_keyframe(const Bytes& bytes) {
  const auto wire = deserialize<wire::MessageUAV>(bytes, kMaxMessageBytes);
  if (const auto* rejected = std::get_if<Rejected>(&wire)) return *rejected;
  PeerKeyframe keyframe = from_wire(std::get<wire::MessageUAV>(wire));
  if (const Problem problem = problem_with(keyframe)) return Rejected{*problem};
  return keyframe;
}

Decoded<StatusSample> decode_status(const Bytes& bytes) {
  const auto wire = deserialize<wire::AgentStatus>(bytes, kMaxStatusBytes);
  if (const auto* rejected = std::get_if<Rejected>(&wire)) return *rejected;
  StatusSample sample = from_wire(std::get<wire::AgentStatus>(wire));
  if (const Problem problem = problem_with(sample.status)) return Rejected{*problem};
  if (sample.hears.size() > kMaxHears) return Rejected{"too many peers in a status"};
  return sample;
}

Decoded<OdometrySample> decode_odometry(const Bytes& bytes) {
  const auto wire = deserialize<wire::Odometry>(bytes, kMaxOdometryBytes);
  if (const auto* rejected = std::get_if<Rejected>(&wire)) return *rejected;
  OdometrySample sample = from_wire(std::get<wire::Odometry>(wire));
  if (!is_agent_name(sample.agent)) return Rejected{"sender is not a drone's name"};
  if (const Problem problem = problem_with(sample.odometry)) return Rejected{*problem};
  sample.odometry.pose.q_world_imu.normalize();
  return sample;
}

}  // namespace covey
