// SPDX-License-Identifier: Apache-2.0
#include "comms/checks.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace covey {
namespace {

constexpr double kUnitTolerance = 1e-3;  // of a quaternion's norm
constexpr double kMaxStateValue = 1e6;   // SI units, whatever it is

template <typename Derived>
bool within(const Eigen::MatrixBase<Derived>& values, double limit) {
  return values.allFinite() && values.cwiseAbs().maxCoeff() <= limit;
}

bool is_status(FilterStatus status) { return status <= FilterStatus::kLost; }

// All eigenvalues above min_sigma^2. The upper triangle alone is read: it alone travels.
template <int N>
bool is_covariance(const Eigen::Matrix<double, N, N>& covariance, double min_sigma) {
  using Square = Eigen::Matrix<double, N, N>;
  if (!within(covariance.diagonal(), kMaxSigma * kMaxSigma) || !covariance.allFinite())
    return false;
  const Square above = covariance - min_sigma * min_sigma * Square::Identity();
  return Eigen::LLT<Square, Eigen::Upper>(above).info() == Eigen::Success;
}

Problem problem_with(const PeerLandmark& landmark) {
  if (!within(landmark.bearing, kMaxBearing)) return "bearing not plausible";
  // Written so that NaN fails too.
  const double rho = landmark.inverse_depth, sigma = landmark.inverse_depth_sigma;
  if (!(rho >= kMinInverseDepth && rho <= kMaxInverseDepth)) return "depth not plausible";
  if (!(sigma >= 0 && sigma <= rho)) return "depth uncertainty not plausible";
  return {};
}

Problem problem_with(const Eigen::Isometry3d& T_world_cam) {
  if (!within(T_world_cam.translation(), kMaxPosition)) return "position not plausible";
  const Eigen::Matrix3d R = T_world_cam.linear();
  if (!within(R.transpose() * R - Eigen::Matrix3d::Identity(), kUnitTolerance))
    return "attitude is not a rotation";
  return {};
}

Problem problem_with(const CameraView& view) {
  if (const Problem problem = problem_with(view.T_world_cam)) return problem;
  // Written so that NaN fails too.
  const double rho = 1 / view.mean_depth;
  if (!(rho >= kMinInverseDepth && rho <= kMaxInverseDepth)) return "depth not plausible";
  if (!(view.sigma >= 0 && view.sigma <= kMaxViewSigma))
    return "uncertainty of the view not plausible";
  return {};
}

Problem problem_with(const KeyframePose& pose) {
  if (!is_stamp(pose.stamp_ns)) return "stamp not plausible";
  if (const Problem problem = problem_with(pose.T_world_cam)) return problem;
  if (!is_covariance<6>(pose.covariance, 0.0))
    return "pose covariance not positive definite or not plausible";
  return {};
}

Problem problem_with(const FoundKeyframe& found) {
  if (const Problem problem = problem_with(found.T_keyframe_cam)) return problem;
  // Written so that NaN fails too.
  if (!(std::abs(found.log_depth_ratio) <= kMaxLogDepthRatio)) return "depth ratio not plausible";
  if (!is_covariance<7>(found.covariance, 0.0))
    return "covariance of what was found not positive definite or not plausible";
  return {};
}

// All but the receiver.
Problem problem_with_content(const PeerKeyframe& keyframe) {
  if (!is_agent_name(keyframe.sender)) return "sender is not a drone's name";
  for (const KeyframePose& pose : {keyframe.pose, keyframe.before}) {
    if (const Problem problem = problem_with(pose)) return problem;
  }
  // Written so that NaN fails too.
  if (!(keyframe.patch_spacing >= 0 && keyframe.patch_spacing <= kMaxPatchSpacing))
    return "patch spacing not plausible";
  if (keyframe.landmarks.size() > kMaxLandmarks) return "too many landmarks";
  if (!keyframe.described && !(keyframe.patch_spacing > 0))
    return "landmarks have neither descriptors nor patches";
  for (const PeerLandmark& landmark : keyframe.landmarks)
    if (const Problem problem = problem_with(landmark)) return problem;
  if (!keyframe.found) return {};
  if (!keyframe.landmarks.empty()) return "what was found comes with landmarks";
  return problem_with(*keyframe.found);
}

bool are_unit(const Eigen::VectorXd& state, Eigen::Index first_clone, Eigen::Index clones) {
  const auto unit = [&](Eigen::Index at) {
    return is_unit(Eigen::Quaterniond(state.segment<4>(at).data()));
  };
  bool good = unit(6) && unit(19);  // q_world_imu, q_imu_cam
  for (Eigen::Index i = 0; i < clones; ++i) good = good && unit(first_clone + 7 * i + 3);
  return good;
}

Problem problem_with(const FilterSnapshot& filter) {
  constexpr Eigen::Index kFirstClone = 24;
  if (!is_stamp(filter.stamp_ns)) return "stamp not plausible";
  const Eigen::Index rows = filter.covariance.rows();
  if (rows != filter.covariance.cols()) return "covariance of the filter is not square";
  if (rows > kMaxFilterDimension) return "filter too large";
  const auto landmarks = static_cast<Eigen::Index>(filter.landmark_tracks.size());
  const Eigen::Index of_clones = filter.state.size() - kFirstClone - 3 * landmarks;
  const Eigen::Index clones = of_clones / 7;
  const Eigen::Index calibration = rows - 15 - 6 * clones - 3 * landmarks;
  if (of_clones < 0 || of_clones % 7 != 0 ||
      filter.landmark_anchors.size() != filter.landmark_tracks.size() ||
      (calibration != 0 && calibration != 1 && calibration != 6 && calibration != 7))
    return "sizes in the filter do not fit together";
  for (const std::uint8_t anchor : filter.landmark_anchors)
    if (anchor >= clones) return "landmark without an anchor";
  if (!within(filter.state, kMaxStateValue)) return "state of the filter not plausible";
  if (!are_unit(filter.state, kFirstClone, clones)) return "attitude is not a unit quaternion";
  // Whether it is positive definite would take milliseconds; nobody inverts it.
  if (!filter.covariance.allFinite() || filter.covariance != filter.covariance.transpose() ||
      filter.covariance.diagonal().minCoeff() <= 0)
    return "covariance of the filter not plausible";
  return {};
}

}  // namespace

bool is_stamp(TimeNs stamp_ns) { return stamp_ns >= 0 && stamp_ns <= kMaxStampNs; }

bool is_agent_name(const std::string& name) {
  const auto allowed = [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' ||
           c == '-';
  };
  return !name.empty() && name.size() <= kMaxNameLength &&
         std::all_of(name.begin(), name.end(), allowed);
}

// Written so that NaN fails too.
bool is_unit(const Eigen::Quaterniond& q) { return std::abs(q.norm() - 1.0) <= kUnitTolerance; }

Problem problem_with(const PlaceAdvert& advert) {
  if (!is_agent_name(advert.sender)) return "sender is not a drone's name";
  if (!is_stamp(advert.stamp_ns)) return "stamp not plausible";
  if (const Problem problem = problem_with(advert.view)) return problem;
  if (advert.descriptor.size() > kMaxDescriptorBytes) return "place descriptor too long";
  return {};
}

Problem problem_with(const PeerKeyframe& keyframe) {
  if (!is_agent_name(keyframe.receiver)) return "receiver is not a drone's name";
  return problem_with_content(keyframe);
}

Problem problem_with(const FullPeerKeyframe& message) {
  const std::string& receiver = message.keyframe.receiver;
  if (!receiver.empty() && !is_agent_name(receiver)) return "receiver is not a drone's name";
  if (message.keyframe.found) return "what was found comes with a whole filter";
  if (const Problem problem = problem_with_content(message.keyframe)) return problem;
  return problem_with(message.filter);
}

Problem problem_with(const AgentStatus& status) {
  if (!is_agent_name(status.agent)) return "sender is not a drone's name";
  if (!is_stamp(status.stamp_ns)) return "stamp not plausible";
  if (!is_status(status.status)) return "unknown filter status";
  return {};
}

Problem problem_with(const Odometry& odometry) {
  if (!is_stamp(odometry.stamp_ns)) return "stamp not plausible";
  if (!is_status(odometry.status)) return "unknown filter status";
  if (!within(odometry.pose.p_world_imu, kMaxPosition)) return "position not plausible";
  if (!is_unit(odometry.pose.q_world_imu)) return "attitude is not a unit quaternion";
  if (!within(odometry.v_world_imu, kMaxSpeed)) return "velocity not plausible";
  if (!within(odometry.gyro_bias, kMaxGyroBias)) return "gyro bias not plausible";
  if (!within(odometry.accel_bias, kMaxAccelBias)) return "accelerometer bias not plausible";
  const bool unknown = odometry.status == FilterStatus::kUninitialized;
  if (unknown && odometry.pose_covariance.isZero(0.0)) return {};
  if (!is_covariance<6>(odometry.pose_covariance, 0.0))
    return "pose covariance not positive definite or not plausible";
  return {};
}

}  // namespace covey
