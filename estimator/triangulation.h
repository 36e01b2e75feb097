// SPDX-License-Identifier: Apache-2.0
//
// A point from its bearings in several known camera poses.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "estimator/observation_model.h"

namespace covey {

struct View {
  CameraPose camera;
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();
  Eigen::Matrix2d whitening = 1e3 * Eigen::Matrix2d::Identity();  // see whitening()
};

struct Triangulation {
  Eigen::Vector3d p_world = Eigen::Vector3d::Zero();
  // Standard deviation of the inverse depth in the first view over its value, from bearing noise
  // alone.
  double relative_depth_error = 0;
};

struct DepthLimits {
  double min_m = 0.2, max_m = 500.0;
};

// Linear start, then Gauss-Newton on (alpha, beta, rho) in the first view. Nothing when the rays do
// not meet in front of every camera within the limits.
[[nodiscard]] std::optional<Triangulation> triangulate(const std::vector<View>& views,
                                                       const DepthLimits& limits);

}  // namespace covey
