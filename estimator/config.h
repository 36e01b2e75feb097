// SPDX-License-Identifier: Apache-2.0
//
// Everything that can be set in the estimator: one struct per concern, a default and a unit for
// each.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

namespace covey {

// Continuous-time densities, as EuRoC sensor.yaml files give them.
struct ImuNoise {
  double gyro_density = 1.7e-4;       // rad/s/sqrt(Hz)
  double accel_density = 2.0e-3;      // m/s2/sqrt(Hz)
  double gyro_random_walk = 2.0e-5;   // rad/s2/sqrt(Hz)
  double accel_random_walk = 3.0e-3;  // m/s3/sqrt(Hz)
  // Between samples farther apart than that acceleration and rate wander (Brownian bridges): a
  // drone that manoeuvres changes them by 2 m/s2 and 1 rad/s in half a second.
  double max_gap_s = 0.05;
  double accel_wander = 3.0;  // m/s2/sqrt(s)
  double gyro_wander = 1.5;   // rad/s/sqrt(s)
};

// Camera-to-IMU calibration: x_imu = T_imu_cam * x_cam; t_imu = t_image + time_offset_s.
struct CameraExtrinsics {
  Eigen::Quaterniond q_imu_cam = Eigen::Quaterniond::Identity();
  Eigen::Vector3d p_imu_cam = Eigen::Vector3d::Zero();  // m
  double time_offset_s = 0.0;                           // s
};

struct EstimatorConfig {
  ImuNoise imu_noise;
  CameraExtrinsics extrinsics;
  // Times the densities of imu_noise. An IMU in flight is noisier than its data sheet says, and the
  // filter's other errors, which nothing else stands for, are best taken for its noise.
  double imu_noise_scale = 1.0;
  double gravity = 9.81;        // m/s2
  double max_imu_gap_s = 0.05;  // longer ones are bridged and counted; imu_noise.max_gap_s is this
  double max_gyro = 35.0;       // rad/s; a sample beyond is refused
  double max_accel = 200.0;     // m/s2; a sample beyond is refused

  // Window and features.
  int max_clones = 11;                   // M: keyframes kept; the present image comes on top
  int max_slam_features = 40;            // N: inverse-depth landmarks in the state
  int max_msckf_features = 40;           // in one update, the longest tracks first
  double observation_noise_scale = 1.0;  // times the sigmas of TrackObservation::covariance
  // Times those again where a track is a SLAM feature. It is used in every image: what its errors
  // have in common with those of the images before counts each time anew.
  double slam_noise_scale = 1.0;
  double gate_confidence = 0.99;  // share of good features that pass the chi-square gate

  // A new keyframe when rotation-free motion of the tracks since the last one exceeds the parallax,
  // or when fewer than this share of the tracks was seen in it.
  double keyframe_parallax = 0.025;  // on the normalised plane
  double keyframe_max_age_s = 0.5;   // s
  double keyframe_min_shared = 0.6;  // share of tracks

  // A landmark is used when its inverse depth is known this well (standard deviation over value).
  double max_msckf_depth_error = 0.25;
  double max_slam_depth_error = 0.10;
  double min_depth = 0.2, max_depth = 500.0;  // m

  // Online calibration, with the standard deviation of what the configuration says.
  bool calibrate_extrinsics = false;
  double extrinsics_sigma_m = 0.01;    // m
  double extrinsics_sigma_rad = 0.01;  // rad
  bool calibrate_time_offset = false;
  double time_offset_sigma_s = 0.005;  // s
  bool calibrate_intrinsics = false;
  double focal_length_sigma = 0.002;     // over the focal length
  double principal_point_sigma = 0.002;  // over the focal length
  double distortion_sigma = 0.002;       // of k1 and of k2

  // Standing still or hovering: no track moves and the inertial readings stay level over the
  // window. The sigmas are what a hover still moves; they hold for one image's pseudo-measurement.
  bool zero_velocity_updates = true;
  double still_window_s = 0.4;         // s
  double still_parallax = 0.0005;      // normalised plane, median over the window, beyond noise
  double still_drift = 0.005;          // the same over two seconds, rotation included
  double still_gyro = 0.03;            // rad/s, change of the mean between the window's halves
  double still_accel = 0.1;            // m/s2, the same
  double still_velocity_sigma = 0.02;  // m/s
  double still_gyro_sigma = 0.03;      // rad/s
  double still_accel_sigma = 0.1;      // m/s2

  // Lost: it says so and starts anew from its last healthy state, carried on by the IMU.
  double lost_after_s = 2.0;   // s with most features gated
  double max_velocity = 60.0;  // m/s
};

}  // namespace covey
