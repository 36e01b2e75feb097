// SPDX-License-Identifier: Apache-2.0
//
// Runs the estimator on one simulated drone and compares it with the truth.
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "apps/disturbed_start.h"
#include "estimator/estimator.h"
#include "estimator/observation_model.h"
#include "estimator/so3.h"
#include "sim/feature_simulation.h"
#include "sim/random.h"
#include "tests/estimator/enough_for_statistics.h"

namespace covey {

struct ErrorSample {
  double time_s = 0;
  double position_m = 0, orientation = 0;  // error norms, m and rad
  // 3 degrees of freedom each.
  double position_nees = 0, orientation_nees = 0, velocity_nees = 0;
};

struct FilterRun {
  std::vector<ErrorSample> errors;  // one for each image that was propagated to
  int still = 0;                    // images in which the drone was taken to stand still
  int reinitialized = 0, refused = 0, used = 0, gated = 0, imu_gaps = 0;
  bool covariance_valid = true;
};

// Over the degrees of freedom.
struct MeanNees {
  double position = 0, orientation = 0;
};

// Once the filter has had time to start.
inline MeanNees mean_nees_once_started(const FilterRun& run) {
  constexpr double kStarted_s = 2;
  constexpr double kDegreesOfFreedom = 3;
  MeanNees sum;
  int count = 0;
  for (const ErrorSample& error : run.errors) {
    if (error.time_s < kStarted_s) continue;
    sum.position += error.position_nees / kDegreesOfFreedom;
    sum.orientation += error.orientation_nees / kDegreesOfFreedom;
    ++count;
  }
  return {sum.position / count, sum.orientation / count};
}

// The true calibration, disturbed by as much as the configuration admits for what it calibrates.
inline CameraExtrinsics disturbed_extrinsics(const CameraExtrinsics& truth,
                                             const EstimatorConfig& config, std::uint64_t seed) {
  Random random(seed, 0xca11);
  CameraExtrinsics extrinsics = truth;
  if (config.calibrate_extrinsics) {
    extrinsics.p_imu_cam += config.extrinsics_sigma_m * random.gaussian_vector();
    extrinsics.q_imu_cam = extrinsics.q_imu_cam *
                           exp_quaternion(config.extrinsics_sigma_rad * random.gaussian_vector());
  }
  if (config.calibrate_time_offset) {
    extrinsics.time_offset_s += config.time_offset_sigma_s * random.gaussian();
  }
  return extrinsics;
}

inline IntrinsicsError intrinsics_error(const EstimatorConfig& config, std::uint64_t seed) {
  Random random(seed, 0xf0ca1);
  IntrinsicsError error = IntrinsicsError::Zero();
  if (!config.calibrate_intrinsics) return error;
  const double focal = config.focal_length_sigma, centre = config.principal_point_sigma;
  const double k = config.distortion_sigma;
  for (double& x : error) x = random.gaussian();
  return error.cwiseProduct((IntrinsicsError() << focal, focal, centre, centre, k, k).finished());
}

// The bearings that intrinsics which are wrong by so much make of the pixels.
inline CameraMeasurement computed_with(const IntrinsicsError& error, CameraMeasurement image) {
  for (TrackObservation& track : image.tracks) {
    track.bearing += pinhole_by_intrinsics(track.bearing) * error;
    track.by_intrinsics = pinhole_by_intrinsics(track.bearing);
  }
  return image;
}

inline ErrorSample compare(const Odometry& odometry, const DroneFeatures& drone) {
  ErrorSample sample;
  sample.time_s = seconds_between(drone.imu.front().stamp_ns, odometry.stamp_ns);
  const Pose truth = drone.trajectory.pose_at(sample.time_s);
  const Eigen::Vector3d dp = truth.p_world_imu - odometry.pose.p_world_imu;
  const Eigen::Vector3d dtheta =
      log_quaternion(odometry.pose.q_world_imu.conjugate() * truth.q_world_imu);
  const Eigen::Matrix3d P_p = odometry.pose_covariance.topLeftCorner<3, 3>();
  const Eigen::Matrix3d P_theta = odometry.pose_covariance.bottomRightCorner<3, 3>();
  sample.position_m = dp.norm();
  sample.orientation = dtheta.norm();
  sample.position_nees = dp.dot(P_p.llt().solve(dp));
  sample.orientation_nees = dtheta.dot(P_theta.llt().solve(dtheta));
  const Eigen::Vector3d dv = drone.trajectory.at(sample.time_s).v_world_imu - odometry.v_world_imu;
  sample.velocity_nees = dv.dot(odometry.velocity_covariance.llt().solve(dv));
  return sample;
}

inline FilterRun run_filter(const DroneFeatures& drone, EstimatorConfig config,
                            std::uint64_t seed) {
  config.extrinsics = disturbed_extrinsics(drone.extrinsics, config, seed);
  const IntrinsicsError of_intrinsics = intrinsics_error(config, seed);
  Estimator estimator(config);
  estimator.initialize(disturbed_start(drone, drone.truth.front().bias, seed));
  FilterRun run;
  std::size_t next_imu = 0;
  // What the clock's uncertainty may ask for beyond the image.
  constexpr TimeNs kAhead_ns = 40'000'000;
  for (const CameraMeasurement& image : drone.camera) {
    const TimeNs until_ns = image.stamp_ns + kAhead_ns;
    while (next_imu < drone.imu.size() && drone.imu[next_imu].stamp_ns <= until_ns) {
      estimator.add_imu(drone.imu[next_imu++]);
    }
    const UpdateReport report = estimator.add_camera(computed_with(of_intrinsics, image));
    run.reinitialized += report.reinitialized ? 1 : 0;
    run.still += report.zero_velocity ? 1 : 0;
    run.imu_gaps += report.imu_gaps;
    run.used += report.slam_used + report.msckf_used;
    run.gated += report.slam_gated + report.msckf_gated;
    run.refused += report.propagated ? 0 : 1;
    if (!report.propagated) continue;
    const Odometry odometry = estimator.odometry();
    run.covariance_valid = run.covariance_valid && odometry.pose_covariance.allFinite() &&
                           odometry.pose_covariance.llt().info() == Eigen::Success;
    run.errors.push_back(compare(odometry, drone));
  }
  return run;
}

}  // namespace covey
