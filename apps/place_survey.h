// SPDX-License-Identifier: Apache-2.0
//
// What the cameras of a dataset saw of the same places, from ground truth alone: the reference
// that place recognition is measured against.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "apps/config_file.h"
#include "apps/dataset.h"
#include "apps/progress.h"
#include "estimator/measurements.h"
#include "frontend/camera.h"

namespace covey {

struct SurveyedView {
  std::string drone;
  TimeNs stamp_ns = 0;
  CameraIntrinsics camera;
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  std::vector<BinaryDescriptor> features;  // as in flight: of tracked corners, oldest track first
  std::vector<Eigen::Vector3d> points_world;  // of those tracks that parallax places well
};

// Throws std::runtime_error for a drone without.
void require_ground_truth(const DroneFolder& drone);

// A view every `interval_s` of the flight, tracked at full rate. Throws std::runtime_error for a
// drone without ground truth, and what `on_image` throws.
[[nodiscard]] std::vector<SurveyedView> survey_flight(const DroneFolder& drone, double interval_s,
                                                      ThermalMode thermal,
                                                      const OnImage& on_image = {});

// Share of the points of either view that lie in the other's image, less than 30 degrees and a
// factor of two in distance from where they were seen, the smaller of both shares. Descriptors
// hardly bridge more. The angle also keeps apart the two sides of a wall. 0..1
[[nodiscard]] double view_overlap(const SurveyedView& a, const SurveyedView& b);

}  // namespace covey
