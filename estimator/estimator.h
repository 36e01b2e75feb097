// SPDX-License-Identifier: Apache-2.0
//
// One drone's filter: IMU and camera measurements in, odometry and reports out. Not thread-safe:
// one thread owns it. Same input, same output.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "estimator/calibration_sigma.h"
#include "estimator/config.h"
#include "estimator/filter_snapshot.h"
#include "estimator/measurements.h"

namespace covey {

// Where the filter starts, with one standard deviation of each error: of position, velocity and
// biases along each axis, of the attitude about the world's axes.
struct InitialState {
  TimeNs stamp_ns = 0;
  Pose pose;
  Eigen::Vector3d v_world_imu = Eigen::Vector3d::Zero();  // m/s
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();    // rad/s, in imu
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();   // m/s2, in imu
  double position_sigma = 1e-3;                           // m
  double yaw_sigma = 1e-3;                                // rad, about z
  double tilt_sigma = 5e-3;                               // rad, about x and about y
  double velocity_sigma = 0.02;                           // m/s
  double gyro_bias_sigma = 0.01;                          // rad/s
  double accel_bias_sigma = 0.1;                          // m/s2
};

// What one camera measurement did. Counts of features unless said otherwise.
struct UpdateReport {
  bool propagated = false;     // false: no IMU up to the image, not newer, or not initialised
  bool reinitialized = false;  // the filter lost itself and started anew at this image
  bool zero_velocity = false;  // standing still was detected and used
  int msckf_used = 0, msckf_gated = 0, msckf_untriangulated = 0;
  int slam_used = 0, slam_gated = 0, slam_initialized = 0;
  int clones = 0, slam_features = 0;
  int imu_gaps = 0, imu_rejected = 0;
  int out_of_order = 0;    // IMU samples not newer than the one before
  int images_refused = 0;  // older than the state, or without IMU up to them
  // Innovation covariance not positive definite: nothing changed, no feature counts as used.
  int failed_updates = 0;
  double propagate_ms = 0, msckf_ms = 0,
         slam_ms = 0;  // filled by the caller's clock, see StageClock
};

struct PeerReport {
  int used = 0, gated = 0, unknown_track = 0, invalid = 0;
  int uninformative = 0;  // agree, but the peer does not know the point much better
};

// A monotonic clock lent by the caller, so that the estimator itself never reads one. May be null.
using StageClock = double (*)();  // ms

// The camera at an image: what its clone and the extrinsics say together.
struct CameraEstimate {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  Matrix6d covariance = Matrix6d::Identity();  // of [dp dtheta], both in world: R = Exp(dtheta) R^
};

class Estimator {
 public:
  explicit Estimator(const EstimatorConfig& config, StageClock clock = nullptr);
  ~Estimator();
  Estimator(Estimator&&) noexcept;
  Estimator& operator=(Estimator&&) noexcept;

  void initialize(const InitialState& start);
  [[nodiscard]] bool initialized() const;

  // IMU samples in time order, up to and a little past the next image. False, and counted, for one
  // that is not finite, beyond the limits, or not newer than the last one.
  bool add_imu(const ImuSample& sample);

  // Propagates to the image, clones, updates, marginalises.
  UpdateReport add_camera(const CameraMeasurement& measurement);

  // An image that shows nothing: only propagates to it. Tracks and landmarks wait for the next one,
  // for three seconds; so they do where no image comes at all.
  UpdateReport pass_image(TimeNs image_stamp_ns);

  // Collaborative update by covariance intersection: own landmarks and a peer's are one point each
  // (paper, eq. 9..17). Of SLAM features and of tracks that are none (MSCKF features to be, and
  // opportunistic ones). If it changes the state, the bearings of those tracks are spent, as after
  // an update of their own: such a track goes on without a past.
  PeerReport add_peer(const KeyframeMatch& match);

  [[nodiscard]] Odometry odometry() const;
  // Carried on by the IMU alone to the last of these samples, which are in time order; the state
  // stays as it is. odometry() itself if none is later.
  [[nodiscard]] Odometry predicted(const std::vector<ImuSample>& samples) const;
  // At the newest image that was propagated to, as calibrated so far. Nothing before the first one,
  // and after the filter has begun anew.
  [[nodiscard]] std::optional<CameraEstimate> camera() const;
  // What the filter knows of the tracks of the newest image: SLAM features and, out of the window's
  // views, tracks that are none (MSCKF features to be, and opportunistic ones).
  [[nodiscard]] std::vector<TrackDepth> depths();
  [[nodiscard]] std::vector<std::uint64_t> slam_tracks() const;  // tracks that are SLAM features
  [[nodiscard]] CameraExtrinsics extrinsics() const;             // as calibrated so far
  [[nodiscard]] IntrinsicsError intrinsics_error() const;        // the same
  [[nodiscard]] CalibrationSigma calibration_sigma() const;
  // For exchanges that send whole filters. Empty before initialisation.
  [[nodiscard]] FilterSnapshot snapshot() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace covey
