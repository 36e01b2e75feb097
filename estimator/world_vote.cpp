// SPDX-License-Identifier: Apache-2.0
#include "estimator/world_vote.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "estimator/camera_view.h"
#include "estimator/so3.h"

namespace covey {
namespace {

constexpr std::size_t kMaxCandidates = 30;

double tilt_of(const Eigen::Matrix3d& R) { return std::acos(std::clamp(R(2, 2), -1.0, 1.0)); }

bool agree(const WorldVoteConfig& config, const RelativePose& a, const RelativePose& b) {
  const Eigen::Isometry3d T_a = world_of(a), T_b = world_of(b);
  const Eigen::Vector3d p = a.other.T_world_cam.translation();
  const double yaw =
      std::remainder(nearest_yaw(T_a.linear()) - nearest_yaw(T_b.linear()), 2 * M_PI);
  return (T_a * p - T_b * p).norm() < config.agree_m && std::abs(yaw) < config.agree_rad;
}

// No two of one keyframe, on either side.
std::vector<RelativePose> of_different_keyframes(const std::vector<RelativePose>& all) {
  std::vector<RelativePose> different;
  for (const RelativePose& candidate : all) {
    const bool repeats =
        std::any_of(different.begin(), different.end(), [&](const RelativePose& other) {
          return other.own.keyframe_id == candidate.own.keyframe_id ||
                 other.other.keyframe_id == candidate.other.keyframe_id;
        });
    if (!repeats) different.push_back(candidate);
  }
  return different;
}

CameraView own_view(const RelativePose& pose) {
  return {pose.own.T_world_cam, pose.own_mean_depth};
}

double spread_of(const std::vector<RelativePose>& poses) {
  double spread = 0;
  for (const RelativePose& a : poses) {
    for (const RelativePose& b : poses) {
      spread = std::max(spread, view_difference(own_view(a), own_view(b)));
    }
  }
  return spread;
}

}  // namespace

Eigen::Isometry3d world_of(const RelativePose& measurement) {
  return measurement.own.T_world_cam * measurement.T_other_own.inverse() *
         measurement.other.T_world_cam.inverse();
}

Eigen::Isometry3d levelled(const Eigen::Isometry3d& T, const Eigen::Vector3d& p_peer) {
  Eigen::Isometry3d level = Eigen::Isometry3d::Identity();
  level.linear() =
      Eigen::AngleAxisd(nearest_yaw(T.linear()), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  level.translation() = T * p_peer - level.linear() * p_peer;
  return level;
}

std::vector<RelativePose> WorldVote::add(const WorldVoteConfig& config,
                                         const RelativePose& measurement) {
  if (tilt_of(world_of(measurement).linear()) > config.max_tilt_rad) return {};
  if (candidates_.size() >= kMaxCandidates) candidates_.erase(candidates_.begin());
  candidates_.push_back(measurement);
  std::vector<RelativePose> agreeing;
  std::copy_if(candidates_.begin(), candidates_.end(), std::back_inserter(agreeing),
               [&](const RelativePose& other) { return agree(config, measurement, other); });
  const bool most = static_cast<double>(agreeing.size()) >=
                    config.share * static_cast<double>(candidates_.size());
  agreeing = of_different_keyframes(agreeing);
  if (!most || agreeing.size() < static_cast<std::size_t>(config.votes) ||
      spread_of(agreeing) < config.spread) {
    return {};
  }
  candidates_.clear();
  return agreeing;
}

}  // namespace covey
