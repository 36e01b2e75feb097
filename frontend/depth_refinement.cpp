// SPDX-License-Identifier: Apache-2.0
#include "frontend/depth_refinement.h"

#include <cmath>

namespace covey {

// z = d r_z + t_z along the ray r of depth 1 there.
std::optional<InverseDepth> depth_in(const Eigen::Isometry3d& T_this_other,
                                     const Eigen::Vector2d& bearing, const InverseDepth& there) {
  if (!(there.value > 0)) return std::nullopt;
  const Eigen::Vector3d ray = T_this_other.linear() * bearing.homogeneous();
  const double d = 1 / there.value;
  const double z = d * ray.z() + T_this_other.translation().z();
  if (!(z > 0)) return std::nullopt;
  const double sigma_d = d * d * there.sigma;
  return InverseDepth{1 / z, std::abs(ray.z()) * sigma_d / (z * z)};
}

KeyframePose measured_on_the_way_to(const KeyframePose& older, const KeyframePose& before,
                                    const KeyframePose& newer, int known, int refined) {
  const auto way = [&older](const KeyframePose& end) {
    return (end.T_world_cam.translation() - older.T_world_cam.translation()).norm();
  };
  return 2 * refined > known && way(newer) > way(before) ? newer : before;
}

}  // namespace covey
