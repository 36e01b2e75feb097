// SPDX-License-Identifier: Apache-2.0
#include "comms/convert.h"

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>
#include <utility>

#include "comms/cdr.h"
#include "comms/checks.h"
#include "idl/covey.h"

namespace covey {
namespace {

template <typename Wire>
Decoded<Wire> deserialize(const Bytes& bytes, std::size_t max_bytes) {
  if (const Problem problem = problem_with_cdr(bytes, max_bytes)) return Rejected{*problem};
  if (bytes[kCdrHeaderBytes] != kWireVersion) return Rejected{"another version of the messages"};
  return from_cdr<Wire>(bytes);
}

// ----------------------------------------------------------------------------- Quantisation
//
// float32 rounds x by at most u |x|, u = 2^-24. Off the diagonal |E_ij| <= u |P_ij| <= u s_i s_j,
// so E + (N-1) u diag(P) is positive semi-definite (Gershgorin, after scaling by s). A diagonal of
// (1 + N u) P_ii, rounded upwards, therefore gives a covariance that is never smaller than the
// original. A rounded bearing errs by 6e-5 at most, a thirtieth of a pixel, and a rounded inverse
// depth by 0.017 %: a standard deviation of the depth below 0.05 % travels as that.

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

// What was rounded is made a unit quaternion again; what never was one stays as it is.
template <typename Scalar>
Eigen::Quaterniond to_quaternion(const std::array<Scalar, 4>& xyzw) {
  Eigen::Quaterniond q;
  q.coeffs() = to_vector(xyzw);
  if (is_unit(q)) q.normalize();
  return q;
}

std::array<float, 4> to_xyzw(const Eigen::Isometry3d& T) {
  return to_array<float, 4>(Eigen::Quaterniond(T.linear()).coeffs());
}

template <typename Scalar>
Eigen::Isometry3d to_isometry(const std::array<Scalar, 3>& translation,
                              const std::array<float, 4>& xyzw) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = to_quaternion(xyzw).toRotationMatrix();
  T.translation() = to_vector(translation);
  return T;
}

constexpr double kBearingUnit = 1.0 / 8192;
constexpr double kDepthSteps = 2048, kDepthOctaves = 16;  // per octave; below 1 1/m
constexpr double kSigmaSteps = 8, kSigmaOctaves = 24, kLeastSigma = 5e-4;
constexpr double kSigmaSlack = 1e-9;  // of a step: what was decoded is encoded as it was

template <typename Integer>
Integer clamped(double value) {
  return static_cast<Integer>(std::clamp<double>(value, std::numeric_limits<Integer>::min(),
                                                 std::numeric_limits<Integer>::max()));
}

void append(const PeerLandmark& landmark, bool described, wire::MessageUAV& out) {
  if (described) {
    out.descriptors().insert(out.descriptors().end(), landmark.descriptor.begin(),
                             landmark.descriptor.end());
  }
  for (const double tangent : {landmark.bearing.x(), landmark.bearing.y()}) {
    out.bearings().push_back(clamped<std::int16_t>(std::round(tangent / kBearingUnit)));
  }
  out.inverse_depths().push_back(clamped<std::uint16_t>(
      std::round((std::log2(landmark.inverse_depth) + kDepthOctaves) * kDepthSteps)));
  const double sigma = std::max(kLeastSigma, landmark.inverse_depth_sigma / landmark.inverse_depth);
  out.depth_sigmas().push_back(clamped<std::uint8_t>(
      std::ceil((std::log2(sigma) + kSigmaOctaves) * kSigmaSteps - kSigmaSlack)));
  if (out.patch_spacing() > 0) {
    out.patches().insert(out.patches().end(), landmark.patch.begin(), landmark.patch.end());
  }
}

std::vector<PeerLandmark> landmarks_of(const wire::MessageUAV& message) {
  std::vector<PeerLandmark> landmarks(message.inverse_depths().size());
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    PeerLandmark& out = landmarks[i];
    if (!message.descriptors().empty()) {
      std::copy_n(&message.descriptors()[out.descriptor.size() * i], out.descriptor.size(),
                  out.descriptor.begin());
    }
    out.bearing =
        kBearingUnit * Eigen::Vector2d(message.bearings()[2 * i], message.bearings()[2 * i + 1]);
    out.inverse_depth = std::exp2(message.inverse_depths()[i] / kDepthSteps - kDepthOctaves);
    out.inverse_depth_sigma =
        out.inverse_depth * std::exp2(message.depth_sigmas()[i] / kSigmaSteps - kSigmaOctaves);
    if (!message.patches().empty()) {
      std::copy_n(&message.patches()[out.patch.size() * i], out.patch.size(), out.patch.begin());
    }
  }
  return landmarks;
}

// Rounded down.
Eigen::Index square_root(std::size_t value) {
  return static_cast<Eigen::Index>(std::sqrt(static_cast<double>(value)));
}

PlaceAdvert from_wire(const wire::RequestUAV& request) {
  PlaceAdvert out;
  out.sender = request.sender().to_string();
  out.keyframe_id = request.keyframe_id();
  out.stamp_ns = request.stamp_ns();
  out.vocabulary_hash = request.vocabulary_hash();
  out.view.T_world_cam = to_isometry(request.p_world_cam(), request.q_world_cam_xyzw());
  out.view.mean_depth = request.mean_depth();
  out.view.sigma = request.view_sigma();
  out.descriptor = request.descriptor();
  return out;
}

KeyframePose from_wire(const wire::CameraPose& pose) {
  KeyframePose out;
  out.keyframe_id = pose.keyframe_id();
  out.stamp_ns = pose.stamp_ns();
  out.T_world_cam = to_isometry(pose.p_world_cam(), pose.q_world_cam_xyzw());
  out.covariance = symmetric<6>(pose.covariance());
  return out;
}

FoundKeyframe from_wire(const wire::FoundKeyframe& found) {
  FoundKeyframe out;
  out.keyframe_id = found.keyframe_id();
  out.T_keyframe_cam = to_isometry(found.p_keyframe_cam(), found.q_keyframe_cam_xyzw());
  out.log_depth_ratio = found.log_depth_ratio();
  out.covariance = symmetric<7>(found.covariance());
  return out;
}

PeerKeyframe from_wire(const wire::MessageUAV& message) {
  PeerKeyframe out;
  out.sender = message.sender().to_string();
  out.receiver = message.receiver().to_string();
  out.request_keyframe_id = message.request_keyframe_id();
  out.pose = from_wire(message.keyframe());
  out.before = message.before().empty() ? out.pose : from_wire(message.before().front());
  out.patch_spacing = message.patch_spacing();
  out.landmarks = landmarks_of(message);
  out.described = out.landmarks.empty() || !message.descriptors().empty();
  if (!message.found().empty()) out.found = from_wire(message.found().front());
  return out;
}

FullPeerKeyframe from_wire(const wire::FullMessageUAV& full) {
  FullPeerKeyframe out;
  out.keyframe = from_wire(full.message());
  FilterSnapshot& filter = out.filter;
  filter.stamp_ns = full.filter_stamp_ns();
  filter.state = Eigen::Map<const Eigen::VectorXd>(full.state().data(),
                                                   static_cast<Eigen::Index>(full.state().size()));
  filter.landmark_tracks = full.landmark_tracks();
  filter.landmark_anchors = full.landmark_anchors();
  const Eigen::Index size = square_root(full.covariance().size());
  filter.covariance =
      Eigen::Map<const Eigen::MatrixXd>(full.covariance().data(), size, size).transpose();
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
  for (const wire::HeardPeer& heard : status.hears())
    out.hears.push_back({heard.peer(), heard.sent_ns(), heard.received_ns()});
  out.sent_ns = status.sent_ns();
  return out;
}

OdometrySample from_wire(const wire::Odometry& odometry) {
  OdometrySample out;
  out.agent = odometry.agent().to_string();
  out.odometry.stamp_ns = odometry.stamp_ns();
  out.odometry.status = static_cast<FilterStatus>(odometry.filter_status());
  out.odometry.pose.p_world_imu = to_vector(odometry.p_world_imu());
  out.odometry.pose.q_world_imu = to_quaternion(odometry.q_world_imu_xyzw());
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
  out.p_world_cam(to_array<float, 3>(advert.view.T_world_cam.translation()));
  out.q_world_cam_xyzw(to_xyzw(advert.view.T_world_cam));
  out.mean_depth(static_cast<float>(advert.view.mean_depth));
  out.view_sigma(static_cast<float>(advert.view.sigma));
  out.descriptor(advert.descriptor);
  return to_cdr(out);
}

namespace {

wire::CameraPose to_wire(const KeyframePose& pose) {
  wire::CameraPose out;
  out.keyframe_id(pose.keyframe_id);
  out.stamp_ns(pose.stamp_ns);
  out.p_world_cam(to_array<double, 3>(pose.T_world_cam.translation()));
  out.q_world_cam_xyzw(to_xyzw(pose.T_world_cam));
  out.covariance(upper_triangle<6>(pose.covariance));
  return out;
}

wire::FoundKeyframe to_wire(const FoundKeyframe& found) {
  wire::FoundKeyframe out;
  out.keyframe_id(found.keyframe_id);
  out.p_keyframe_cam(to_array<float, 3>(found.T_keyframe_cam.translation()));
  out.q_keyframe_cam_xyzw(to_xyzw(found.T_keyframe_cam));
  out.log_depth_ratio(static_cast<float>(found.log_depth_ratio));
  out.covariance(upper_triangle<7>(found.covariance));
  return out;
}

wire::MessageUAV to_wire(const PeerKeyframe& keyframe) {
  wire::MessageUAV out;
  out.version(kWireVersion);
  out.sender(keyframe.sender);
  out.receiver(keyframe.receiver);
  out.request_keyframe_id(keyframe.request_keyframe_id);
  out.keyframe(to_wire(keyframe.pose));
  if (keyframe.before.keyframe_id != keyframe.pose.keyframe_id) {
    out.before().push_back(to_wire(keyframe.before));
  }
  out.patch_spacing(static_cast<float>(keyframe.patch_spacing));
  for (const PeerLandmark& landmark : keyframe.landmarks) append(landmark, keyframe.described, out);
  if (keyframe.found) out.found().push_back(to_wire(*keyframe.found));
  return out;
}

}  // namespace

Bytes encode(const PeerKeyframe& keyframe) {
  assert(!problem_with(keyframe));
  return to_cdr(to_wire(keyframe));
}

Bytes encode(const FullPeerKeyframe& message) {
  assert(!problem_with(message));
  const FilterSnapshot& filter = message.filter;
  wire::FullMessageUAV out;
  out.message(to_wire(message.keyframe));
  out.filter_stamp_ns(filter.stamp_ns);
  out.state({filter.state.begin(), filter.state.end()});
  out.landmark_tracks(filter.landmark_tracks);
  out.landmark_anchors(filter.landmark_anchors);
  // Symmetric: by columns or by rows is the same.
  out.covariance({filter.covariance.data(), filter.covariance.data() + filter.covariance.size()});
  return to_cdr(out);
}

namespace {

wire::HeardPeer to_wire(const HeardPeer& heard) {
  wire::HeardPeer out;
  out.peer(heard.token);
  out.sent_ns(heard.sent_ns);
  out.received_ns(heard.received_ns);
  return out;
}

}  // namespace

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
  out.sent_ns(sample.sent_ns);
  for (const HeardPeer& heard : sample.hears) out.hears().push_back(to_wire(heard));
  return to_cdr(out);
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
  return to_cdr(out);
}

// --------------------------------------------------------------------------------------- decode

namespace {

// What only the wire can hold; everything else is checked once it is plain.
template <typename Wire>
Problem problem_on_wire(const Wire& /*any other*/) {
  return {};
}

// Made a rotation matrix, zeros would be the identity.
Problem problem_with_attitude(const std::array<float, 4>& xyzw) {
  if (!is_unit(to_quaternion(xyzw))) return "attitude is not a unit quaternion";
  return {};
}

Problem problem_on_wire(const wire::RequestUAV& request) {
  return problem_with_attitude(request.q_world_cam_xyzw());
}

Problem problem_on_wire(const wire::MessageUAV& message) {
  const std::size_t count = message.inverse_depths().size();
  if ((!message.descriptors().empty() &&
       message.descriptors().size() != std::tuple_size_v<ShortDescriptor> * count) ||
      message.bearings().size() != 2 * count || message.depth_sigmas().size() != count ||
      message.patches().size() !=
          (message.patch_spacing() > 0 ? std::tuple_size_v<LandmarkPatch> * count : 0)) {
    return "landmark lists of different lengths";
  }
  if (message.before().size() > 1) return "more than one keyframe before";
  if (message.found().size() > 1) return "more than one keyframe found";
  if (const Problem problem = problem_with_attitude(message.keyframe().q_world_cam_xyzw())) {
    return problem;
  }
  for (const wire::CameraPose& before : message.before()) {
    if (const Problem problem = problem_with_attitude(before.q_world_cam_xyzw())) return problem;
  }
  for (const wire::FoundKeyframe& found : message.found()) {
    if (const Problem problem = problem_with_attitude(found.q_keyframe_cam_xyzw())) return problem;
  }
  return {};
}

Problem problem_on_wire(const wire::FullMessageUAV& full) {
  const std::size_t size = full.covariance().size();
  const auto root = static_cast<std::size_t>(square_root(size));
  if (size == 0 || root * root != size) return "covariance of the filter is not square";
  return problem_on_wire(full.message());
}

Problem problem_with(const StatusSample& sample) {
  if (sample.hears.size() > kMaxHears) return "too many peers in a status";
  if (!is_stamp(sample.sent_ns)) return "stamp not plausible";
  for (const HeardPeer& heard : sample.hears)
    if (!is_stamp(heard.sent_ns) || !is_stamp(heard.received_ns)) return "stamp not plausible";
  return covey::problem_with(sample.status);
}

Problem problem_with(const OdometrySample& sample) {
  if (!is_agent_name(sample.agent)) return "sender is not a drone's name";
  return covey::problem_with(sample.odometry);
}

template <typename Wire>
auto decode(const Bytes& bytes, std::size_t max_bytes)
    -> Decoded<decltype(from_wire(std::declval<const Wire&>()))> {
  const Decoded<Wire> decoded = deserialize<Wire>(bytes, max_bytes);
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) return *rejected;
  const Wire& wire = std::get<Wire>(decoded);
  if (const Problem problem = problem_on_wire(wire)) return Rejected{*problem};
  auto plain = from_wire(wire);
  if (const Problem problem = problem_with(plain)) return Rejected{*problem};
  return plain;
}

}  // namespace

Decoded<PlaceAdvert> decode_place_advert(const Bytes& bytes) {
  return decode<wire::RequestUAV>(bytes, kMaxRequestBytes);
}

Decoded<PeerKeyframe> decode_peer_keyframe(const Bytes& bytes) {
  return decode<wire::MessageUAV>(bytes, kMaxMessageBytes);
}

Decoded<FullPeerKeyframe> decode_full_keyframe(const Bytes& bytes) {
  return decode<wire::FullMessageUAV>(bytes, kMaxFullMessageBytes);
}

Decoded<StatusSample> decode_status(const Bytes& bytes) {
  return decode<wire::AgentStatus>(bytes, kMaxStatusBytes);
}

std::string key_of_status(const Bytes& bytes) {
  const Decoded<StatusSample> decoded = decode_status(bytes);
  const auto* sample = std::get_if<StatusSample>(&decoded);
  return sample == nullptr ? "" : sample->status.agent;
}

Decoded<OdometrySample> decode_odometry(const Bytes& bytes) {
  return decode<wire::Odometry>(bytes, kMaxOdometryBytes);
}

}  // namespace covey
