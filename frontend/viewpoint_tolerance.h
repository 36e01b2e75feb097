// SPDX-License-Identifier: Apache-2.0
//
// How many of a keyframe's landmarks will be found again from somewhere else, before they are sent
// there. Landmarks look the less alike the larger the angle between the directions in which they
// are seen: they are found with a chance of exp(-angle / tolerance). Bare ground allows larger
// angles than what has edges, so the tolerance is learnt from what is found.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <vector>

#include "frontend/camera.h"

namespace covey {

// m, in the frame of the camera that has seen it.
template <typename Landmark>
[[nodiscard]] Eigen::Vector3d position_of(const Landmark& landmark) {
  return landmark.bearing.homogeneous() / landmark.inverse_depth;
}

template <typename Landmarks>
[[nodiscard]] std::vector<Eigen::Vector3d> positions_of(const Landmarks& landmarks) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(landmarks.size());
  for (const auto& landmark : landmarks) positions.push_back(position_of(landmark));
  return positions;
}

// Is a point (m, in cam) before the camera and in its image, so far from the border?
[[nodiscard]] bool is_in_sight(const CameraIntrinsics& camera, const Eigen::Vector3d& p_cam,
                               double margin_px = 0);

// The angles, rad, between the directions from which two cameras see landmarks (m, in the frame of
// the one that has seen them), of those that are in the other one's image.
[[nodiscard]] std::vector<double> viewing_angles(const std::vector<Eigen::Vector3d>& landmarks,
                                                 const Eigen::Isometry3d& T_seen_other,
                                                 const CameraIntrinsics& camera);

class ViewpointTolerance {
 public:
  // Of the landmarks that are seen with these angles.
  [[nodiscard]] double expected_finds(const std::vector<double>& angles) const;

  // So many of them were found.
  void learn(const std::vector<double>& angles, std::size_t found);

  [[nodiscard]] double tolerance() const;  // rad

 private:
  // Sums over landmarks; a loss is -log of the share that is found. At first a guess, worth a few
  // landmarks and rather large: what is not answered is not learnt from.
  double angles_ = 3;  // rad
  double losses_ = angles_ / 1.2;
};

}  // namespace covey
