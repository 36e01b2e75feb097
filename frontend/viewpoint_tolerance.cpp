// SPDX-License-Identifier: Apache-2.0
#include "frontend/viewpoint_tolerance.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace covey {

bool is_in_sight(const CameraIntrinsics& camera, const Eigen::Vector3d& p_cam, double margin_px) {
  constexpr double kMinDepth = 0.1;  // m
  if (!(p_cam.z() > kMinDepth)) return false;
  const Eigen::Vector2d bearing = p_cam.hnormalized();
  return is_in_image(camera, project(camera, bearing), margin_px) && is_on_lens(camera, bearing);
}

std::vector<double> viewing_angles(const std::vector<Eigen::Vector3d>& landmarks,
                                   const Eigen::Isometry3d& T_seen_other,
                                   const CameraIntrinsics& camera) {
  std::vector<double> angles;
  angles.reserve(landmarks.size());
  const Eigen::Isometry3d T_other_seen = T_seen_other.inverse();
  for (const Eigen::Vector3d& landmark : landmarks) {
    if (!is_in_sight(camera, T_other_seen * landmark)) continue;
    const Eigen::Vector3d from_other = landmark - T_seen_other.translation();
    angles.push_back(std::atan2(landmark.cross(from_other).norm(), landmark.dot(from_other)));
  }
  return angles;
}

double ViewpointTolerance::tolerance() const { return angles_ / losses_; }

double ViewpointTolerance::expected_finds(const std::vector<double>& angles) const {
  return std::accumulate(angles.begin(), angles.end(), 0.0, [&](double sum, double angle) {
    return sum + std::exp(-angle * losses_ / angles_);
  });
}

void ViewpointTolerance::learn(const std::vector<double>& angles, std::size_t found) {
  constexpr double kMemory = 5000;  // landmarks: the drone flies on, to other places
  const auto looked_for = static_cast<double>(angles.size());
  const double hits = std::min(static_cast<double>(found), looked_for);
  const double share = (hits + 0.5) / (looked_for + 1);  // never none or all
  const double kept = std::exp(-looked_for / kMemory);
  angles_ = std::accumulate(angles.begin(), angles.end(), kept * angles_);
  losses_ = kept * losses_ - looked_for * std::log(share);
}

}  // namespace covey
