// SPDX-License-Identifier: Apache-2.0
#include "frontend/viewpoint_tolerance.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace covey {

std::vector<double> viewing_angles(const std::vector<Eigen::Vector3d>& landmarks,
                                   const Eigen::Isometry3d& T_seen_other,
                                   const CameraIntrinsics& camera) {
  constexpr double kMinDepth = 0.1;  // m
  const Eigen::Isometry3d T_other_seen = T_seen_other.inverse();
  std::vector<double> angles;
  angles.reserve(landmarks.size());
  for (const Eigen::Vector3d& p : landmarks) {
    const Eigen::Vector3d q = T_other_seen * p;
    if (!(q.z() > kMinDepth)) continue;
    if (!is_in_image(camera, project(camera, q.hnormalized()))) continue;
    const Eigen::Vector3d from_other = p - T_seen_other.translation();
    angles.push_back(std::atan2(p.cross(from_other).norm(), p.dot(from_other)));
  }
  return angles;
}

double ViewpointTolerance::tolerance() const { return std::sqrt(squared_angles_ / losses_); }

double ViewpointTolerance::expected_finds(const std::vector<double>& angles) const {
  return std::accumulate(angles.begin(), angles.end(), 0.0, [&](double sum, double angle) {
    return sum + std::exp(-angle * angle * losses_ / squared_angles_);
  });
}

void ViewpointTolerance::learn(const std::vector<double>& angles, std::size_t found) {
  constexpr double kMemory = 5000;  // landmarks: the drone flies on, to other places
  const auto looked_for = static_cast<double>(angles.size());
  const double hits = std::min(static_cast<double>(found), looked_for);
  const double share = (hits + 0.5) / (looked_for + 1);  // never none or all
  const double kept = std::exp(-looked_for / kMemory);
  squared_angles_ =
      std::inner_product(angles.begin(), angles.end(), angles.begin(), kept * squared_angles_);
  losses_ = kept * losses_ - looked_for * std::log(share);
}

}  // namespace covey
