// SPDX-License-Identifier: Apache-2.0
//
// ORB descriptors (Rublee et al. 2011) of given places of an image, oriented by the intensity
// centroid, or by the world where the camera's attitude is known.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <optional>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/camera.h"

namespace covey {

// One for each place, nothing for those too near to the edge. `image`: CV_8UC1. `directions_deg`:
// which way each patch's x axis points, from image x towards image y; empty: to the intensity
// centroid.
[[nodiscard]] std::vector<std::optional<BinaryDescriptor>> describe_places(
    const cv::Mat& image, const std::vector<Eigen::Vector2d>& pixels,
    const std::vector<float>& directions_deg = {});

// Where a direction of the world points in the image, for each bearing, degrees. Two drones that
// share a frame agree on it better than on an intensity centroid. It is down for a camera that
// looks about level, at walls; a camera that looks up or down sees level ground turn about down, so
// there it is the world's x axis.
[[nodiscard]] std::vector<float> world_directions_deg(const CameraIntrinsics& camera,
                                                      const std::vector<Eigen::Vector2d>& bearings,
                                                      const Eigen::Matrix3d& R_world_cam);

}  // namespace covey
