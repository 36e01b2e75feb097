// SPDX-License-Identifier: Apache-2.0
//
// The filter's state: nominal values, first estimates for the Jacobians, and one covariance.
//
// Error state, in this order:
//   IMU          [dp dv dtheta dbg dba]                     15   (paper eq. 3)
//   scale        [ds]                                       1
//   calibration  [dp_imu_cam dtheta_imu_cam] [dt_offset]    6, 1 and 6 as far as it is estimated
//                IntrinsicsError
//   clones       [dp dtheta] each, IMU pose at an image     6 M  (paper eq. 4)
//   landmarks    [dalpha dbeta drho] each, anchored         3 N  (paper eq. 5)
// Rotation errors are local: q = q_hat * Exp(dtheta). What is measured in metres is relative to the
// scale: where the camera is, v and rho change by exp(ds) about a fixed point c, that is
//   p = p_hat + dp + (exp(ds) - 1) (p_hat + dp + R p_imu_cam - c)
//   v = exp(ds) (v_hat + dv)        rho = exp(-ds) (rho_hat + drho)
// Bearings do not depend on ds, wherever they are linearised; what does is how fast the IMU says
// that velocity changes, and how far the camera swings about the IMU. With the scale spread over
// positions, velocities and depths instead, each update linearises a little elsewhere along it, and
// all together claim to have seen it.
//
// Before the first visual update there is nothing that has a scale in common: until
// separate_scale() ds is zero, and certain. Clones are IMU poses, not camera poses as in the paper,
// so that extrinsics which are calibrated online move all of them at once.
//
// First-estimate Jacobians (Huang, Mourikis, Roumeliotis, IJRR 2010): every pose and landmark is
// linearised where it was first estimated (`first`), so that the filter never believes it has
// learnt the global position and yaw that nothing observes. Once depths are known: before that,
// forget_first_estimates().
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "estimator/config.h"
#include "estimator/imu_increment.h"
#include "estimator/measurements.h"

namespace covey {

// Biases: what the IMU reads minus what is true.
struct ImuState {
  TimeNs stamp_ns = 0;
  Pose pose;
  Eigen::Vector3d v_world_imu = Eigen::Vector3d::Zero();  // m/s
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();    // rad/s, in imu
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();   // m/s2, in imu
};

// What is left of a state without clones and landmarks.
struct CoreState {
  ImuState imu;
  CameraExtrinsics extrinsics;
  IntrinsicsError intrinsics_error = IntrinsicsError::Zero();
  Eigen::MatrixXd covariance;  // of IMU, scale and calibration as in State, all in metres: ds = 0
};

struct Clone {
  std::uint64_t id = 0;
  TimeNs stamp_ns = 0;    // of the image
  bool keyframe = false;  // stays in the window; others leave with the next image
  Pose pose, first;
};

// A SLAM feature: (x/z, y/z, 1/z) in the anchor clone's camera.
struct SlamLandmark {
  std::uint64_t track_id = 0;
  std::uint64_t anchor_id = 0;  // Clone::id, always a keyframe
  Eigen::Vector3d inverse_depth = Eigen::Vector3d::Zero();
  Eigen::Vector3d first = Eigen::Vector3d::Zero();
  int gated_in_a_row = 0;
};

class State {
 public:
  static constexpr int kPosition = 0, kVelocity = 3, kRotation = 6, kGyroBias = 9, kAccelBias = 12;
  static constexpr int kImuSize = 15, kScale = kImuSize;

  State(const EstimatorConfig& config, const ImuState& imu,
        const Eigen::Matrix<double, kImuSize, kImuSize>& imu_covariance);
  // `core`: of a state with this configuration.
  State(const EstimatorConfig& config, const CoreState& core);

  [[nodiscard]] const ImuState& imu() const { return imu_; }
  [[nodiscard]] const CameraExtrinsics& extrinsics() const { return extrinsics_; }
  [[nodiscard]] const IntrinsicsError& intrinsics_error() const { return intrinsics_error_; }
  [[nodiscard]] const std::vector<Clone>& clones() const { return clones_; }
  [[nodiscard]] const std::vector<SlamLandmark>& landmarks() const { return landmarks_; }
  [[nodiscard]] int dimension() const { return dimension_; }
  [[nodiscard]] auto covariance() const { return P_.topLeftCorner(dimension_, dimension_); }
  // Of the first `size` components, scale and calibration among them, were all in metres. Symmetric
  // to the last bit.
  [[nodiscard]] Eigen::MatrixXd metric_covariance(int size) const;
  [[nodiscard]] CoreState core() const;

  // Where things stand in the error state; -1 when not estimated.
  [[nodiscard]] int extrinsics_offset() const { return extrinsics_offset_; }
  [[nodiscard]] int time_offset_offset() const { return time_offset_offset_; }
  [[nodiscard]] int intrinsics_offset() const { return intrinsics_offset_; }
  // What bearings depend on, SLAM features apart: calibration and clones.
  static constexpr int kWindow = kScale + 1;
  [[nodiscard]] int window_size() const { return landmark_offset(0) - kWindow; }
  [[nodiscard]] int clones_offset() const { return clones_offset_; }
  [[nodiscard]] int clone_offset(int index) const { return clones_offset() + 6 * index; }
  [[nodiscard]] int landmark_offset(int index) const {
    return clones_offset() + 6 * static_cast<int>(clones_.size()) + 3 * index;
  }
  // Index of a clone or landmark by its id, -1 when it is not there.
  [[nodiscard]] int find_clone(std::uint64_t id) const;
  [[nodiscard]] int find_landmark(std::uint64_t track_id) const;
  // The largest dimension that the configuration allows.
  [[nodiscard]] int capacity() const { return static_cast<int>(P_.rows()); }

  // Carries the IMU state over one increment, with its noise and the biases' random walk.
  void propagate(const ImuIncrement& increment, TimeNs stamp_ns, double gravity,
                 const ImuNoise& noise);
  // Copies the present IMU pose into the window. `rate_imu`: for the time offset's column.
  void add_clone(std::uint64_t id, TimeNs image_stamp_ns, bool keyframe,
                 const Eigen::Vector3d& rate_imu);
  void remove_clone(int index);
  // `cross`: 3 x dimension(), covariance of the new landmark with the state; `own`: 3 x 3.
  void add_landmark(const SlamLandmark& landmark, const Eigen::MatrixXd& cross,
                    const Eigen::Matrix3d& own);
  void remove_landmark(int index);
  // New anchor and coordinates; `J`: 3 x dimension(), d(new coordinates)/d(error state).
  void reanchor_landmark(int index, const SlamLandmark& moved, const Eigen::MatrixXd& J);
  void count_gated(int landmark_index, bool gated);

  // From here on what the landmarks' depths have in common is ds, or the distances between clones
  // as long as there is no landmark, and the rest is relative to it.
  void separate_scale();
  // What depths have in common since, over their values: visual scale drifts.
  [[nodiscard]] double common_depth_sigma() const;
  // All in metres again.
  void merge_scale();

  // A clone moves with the time offset as fast as the drone flew then: as `seen` has it by now, not
  // as the IMU alone had it. `seen`: of the same clones.
  void relinearize_time_offset(const State& seen);
  // Linearise everything at the present values from here on. Only while first estimates are worth
  // less than what they guard: until depths are known.
  void forget_first_estimates();
  // Error that takes the other state's window to this one's, both without a separate scale.
  [[nodiscard]] Eigen::VectorXd window_minus(const State& other) const;

  // x <- x (+) dx,  P <- P - W W^T.
  void correct(const Eigen::VectorXd& dx, const Eigen::Ref<const Eigen::MatrixXd>& W);
  // x <- x (+) dx,  P <- P - G D G^T, for a symmetric D that need not be positive (covariance
  // intersection); the caller vouches that the result is positive definite.
  void correct(const Eigen::VectorXd& dx, const Eigen::MatrixXd& G, const Eigen::MatrixXd& D);

 private:
  void apply(const Eigen::VectorXd& dx);
  // What of the velocity's change `dv` within `dt` tells of the scale; `noise_variance`: that the
  // IMU's noise adds to dv, in all. The same noise stands in the innovation that the scale is
  // corrected by: counted in full it made the scale of slow flights grow (errors in variables).
  Eigen::Vector3d without_noise(const Eigen::Vector3d& dv, double dt, double noise_variance);
  // Where the camera is, in the world.
  [[nodiscard]] Eigen::Vector3d camera(const Pose& pose) const;
  [[nodiscard]] Eigen::VectorXd change_by_scale() const;
  [[nodiscard]] Eigen::RowVectorXd common_distance() const;
  [[nodiscard]] Eigen::RowVectorXd common_depth() const;
  void rescale(double ratio);
  void mirror_lower();
  void insert_rows(int offset, int size);
  void remove_rows(int offset, int size);

  // How velocity has changed of late as far as vision and IMU agree on it.
  struct Trend {
    Eigen::Vector3d a_world_imu = Eigen::Vector3d::Zero();
    Eigen::Vector3d v_world_imu = Eigen::Vector3d::Zero();  // at the last increment's start
    double duration_s = 0;                                  // of the last increment
  };

  ImuState imu_, imu_first_;
  Trend trend_;
  CameraExtrinsics extrinsics_;
  IntrinsicsError intrinsics_error_ = IntrinsicsError::Zero();
  std::vector<Clone> clones_;
  std::vector<SlamLandmark> landmarks_;
  Eigen::Vector3d scale_origin_ = Eigen::Vector3d::Zero();  // c, m
  int extrinsics_offset_ = -1, time_offset_offset_ = -1, intrinsics_offset_ = -1;
  int clones_offset_ = kWindow;
  int dimension_ = 0;
  Eigen::MatrixXd P_;  // capacity x capacity; the top left dimension_ x dimension_ is in use
};

}  // namespace covey
