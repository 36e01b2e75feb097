// SPDX-License-Identifier: Apache-2.0
#include "frontend/message_checks.h"

#include <algorithm>
#include <cmath>

namespace covey {
namespace {

constexpr double kMaxCoordinate = 1e6;  // m

bool is_plausible(const Eigen::Isometry3d& T_world_cam) {
  constexpr double kNearlyUnit = 1e-3;
  const Eigen::Matrix3d R = T_world_cam.linear();
  return T_world_cam.matrix().allFinite() && (R.transpose() * R).isIdentity(kNearlyUnit) &&
         R.determinant() > 0 && T_world_cam.translation().cwiseAbs().maxCoeff() <= kMaxCoordinate;
}

bool is_finite(const FoundKeyframe& found) {
  return found.T_keyframe_cam.matrix().allFinite() && std::isfinite(found.log_depth_ratio) &&
         found.covariance.allFinite();
}

}  // namespace

bool is_plausible(const CameraView& view) {
  // Written so that NaN fails too.
  return is_plausible(view.T_world_cam) && view.mean_depth > 0 && std::isfinite(view.mean_depth) &&
         view.sigma >= 0;
}

bool is_well_formed(const PeerKeyframe& message) {
  if (message.sender.empty() || message.landmarks.size() > kMaxPeerLandmarks) return false;
  if (!std::isfinite(message.patch_spacing)) return false;
  if (message.found && !is_finite(*message.found)) return false;
  for (const KeyframePose& pose : {message.pose, message.before}) {
    if (!is_plausible(pose.T_world_cam) || !pose.covariance.allFinite()) return false;
  }
  return std::all_of(
      message.landmarks.begin(), message.landmarks.end(), [](const PeerLandmark& landmark) {
        return landmark.bearing.allFinite() && std::isfinite(landmark.inverse_depth) &&
               landmark.inverse_depth > 0 && std::isfinite(landmark.inverse_depth_sigma);
      });
}

}  // namespace covey
