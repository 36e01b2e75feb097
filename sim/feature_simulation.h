// SPDX-License-Identifier: Apache-2.0
//
// What a team's estimators receive, without images: known landmarks in one world, seen as tracks
// with noise, outliers and losses, and the IMU beside them. Quick enough for thousands of runs.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "estimator/config.h"
#include "estimator/measurements.h"
#include "sim/imu.h"
#include "sim/scenario_motion.h"
#include "sim/trajectory.h"

namespace covey {

struct FeatureCamera {
  double rate_hz = 15;
  double first_image_s = 0.0;  // after the first IMU sample, on the IMU clock
  double time_offset_s = 0.0;  // t_imu = t_image + time_offset_s, what the stamps lack
  double focal_px = 455;
  double width_px = 752, height_px = 480;
  double min_depth = 0.3, max_depth = 45;  // m
  double pixel_sigma = 0.7;                // px, of either component
  double outlier_share = 0.0;              // of all observations
  double outlier_px = 30;                  // outliers lie 5 px to this far from the truth
  double loss_share = 0.035;               // of the tracks, in each image, for no visible reason
  int max_tracks = 120;
};

struct FeatureScenario {
  FlightRequest flight;  // its seed is replaced by the simulation's
  FeatureCamera camera;
  ImuSensor imu = adis16448();
  int landmarks = 0;  // in the whole world; 0: enough for the scenario
  TimeNs start_ns = 1'000'000'000;
};

// Truth at one image, at the instant of its exposure: stamp + time_offset_s.
struct ImageTruth {
  KinematicState state;
  ImuBias bias;
  std::vector<char> outlier;  // for each track of the measurement: 1 if it is an outlier
};

struct DroneFeatures {
  std::string name;
  Trajectory trajectory;
  CameraExtrinsics extrinsics;  // the true ones, time offset included
  std::vector<ImuSample> imu;
  std::vector<CameraMeasurement> camera;
  std::vector<ImageTruth> truth;                                     // one for each measurement
  std::unordered_map<std::uint64_t, std::size_t> landmark_of_track;  // index into landmarks_world
};

struct FeatureSimulation {
  std::vector<Eigen::Vector3d> landmarks_world;  // m
  std::vector<DroneFeatures> drones;
};

[[nodiscard]] FeatureSimulation simulate_features(const FeatureScenario& scenario,
                                                  std::uint64_t seed);

}  // namespace covey
