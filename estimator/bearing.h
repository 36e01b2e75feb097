// SPDX-License-Identifier: Apache-2.0
//
// Where a point of the camera's frame is seen on the normalised (z = 1) image plane: its bearing,
// (x/z, y/z) in cam.
#pragma once

#include <Eigen/Core>

namespace covey {

using Matrix23d = Eigen::Matrix<double, 2, 3>;

// d(bearing)/d(point), 2x3, both in cam, of the point at depth 1 that is seen there; at depth z it
// is 1/z of that.
[[nodiscard]] inline Matrix23d bearing_by_point_at_depth_1(const Eigen::Vector2d& bearing) {
  Matrix23d J;
  J << 1, 0, -bearing.x(), 0, 1, -bearing.y();
  return J;
}

}  // namespace covey
