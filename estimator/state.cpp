// SPDX-License-Identifier: Apache-2.0
#include "estimator/state.h"

#include <algorithm>
#include <cassert>

#include "estimator/calibration_sigma.h"
#include "estimator/imu_transition.h"
#include "estimator/so3.h"

namespace covey {
namespace {

constexpr int kSpareClones = 2;  // the present image and the last one that was no keyframe

void rotate_locally(Eigen::Quaterniond& q, const Eigen::Vector3d& dtheta) {
  q = (q * exp_quaternion(dtheta)).normalized();
}

}  // namespace

State::State(const EstimatorConfig& config, const ImuState& imu,
             const Eigen::Matrix<double, kImuSize, kImuSize>& imu_covariance)
    : imu_(imu), imu_first_(imu), extrinsics_(config.extrinsics) {
  if (config.calibrate_extrinsics) {
    extrinsics_offset_ = kImuSize;
    calibration_size_ += 6;
  }
  if (config.calibrate_time_offset) {
    time_offset_offset_ = kImuSize + calibration_size_;
    calibration_size_ += 1;
  }
  if (config.calibrate_intrinsics) {
    intrinsics_offset_ = kImuSize + calibration_size_;
    calibration_size_ += kIntrinsicsSize;
  }
  const int capacity = kImuSize + calibration_size_ + 6 * (config.max_clones + kSpareClones) +
                       3 * config.max_slam_features;
  P_.setZero(capacity, capacity);
  dimension_ = kImuSize + calibration_size_;
  P_.topLeftCorner<kImuSize, kImuSize>() = imu_covariance;
  const CalibrationSigma sigma = calibration_sigma_at_start(config);
  if (extrinsics_offset_ >= 0) {
    P_.diagonal().segment<3>(extrinsics_offset_) = sigma.p_imu_cam.cwiseAbs2();
    P_.diagonal().segment<3>(extrinsics_offset_ + 3) = sigma.theta_imu_cam.cwiseAbs2();
  }
  if (time_offset_offset_ >= 0) {
    P_(time_offset_offset_, time_offset_offset_) = sigma.time_offset_s * sigma.time_offset_s;
  }
  if (intrinsics_offset_ >= 0) {
    P_.diagonal().segment<kIntrinsicsSize>(intrinsics_offset_) = sigma.intrinsics.cwiseAbs2();
  }
  clones_.reserve(static_cast<std::size_t>(config.max_clones) + kSpareClones);
  landmarks_.reserve(static_cast<std::size_t>(config.max_slam_features));
}

State::State(const EstimatorConfig& config, const CoreState& core)
    : State(config, core.imu, core.covariance.topLeftCorner<kImuSize, kImuSize>()) {
  assert(core.covariance.rows() == dimension_);
  extrinsics_ = core.extrinsics;
  intrinsics_error_ = core.intrinsics_error;
  P_.topLeftCorner(dimension_, dimension_) = core.covariance;
}

CoreState State::core() const {
  return {imu_, extrinsics_, intrinsics_error_, P_.topLeftCorner(clones_offset(), clones_offset())};
}

int State::find_clone(std::uint64_t id) const {
  for (std::size_t i = 0; i < clones_.size(); ++i) {
    if (clones_[i].id == id) return static_cast<int>(i);
  }
  return -1;
}

int State::find_landmark(std::uint64_t track_id) const {
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    if (landmarks_[i].track_id == track_id) return static_cast<int>(i);
  }
  return -1;
}

void State::propagate(const ImuIncrement& increment, TimeNs stamp_ns, double gravity,
                      const ImuNoise& noise) {
  const Eigen::Vector3d g(0, 0, -gravity);
  const ImuState end = carried_over(imu_, increment, stamp_ns, g);
  const auto F = transition(increment, imu_first_, end, g);
  const int rest = dimension_ - kImuSize;
  const Eigen::Matrix<double, kImuSize, kImuSize> P_imu = P_.topLeftCorner<kImuSize, kImuSize>();
  P_.topLeftCorner<kImuSize, kImuSize>() =
      F * P_imu * F.transpose() +
      process_noise(increment, imu_.pose.q_world_imu.toRotationMatrix(), noise);
  if (rest > 0) {
    P_.block(0, kImuSize, kImuSize, rest) = (F * P_.block(0, kImuSize, kImuSize, rest)).eval();
    P_.block(kImuSize, 0, rest, kImuSize) = P_.block(0, kImuSize, kImuSize, rest).transpose();
  }
  imu_ = end;
  imu_first_ = end;
}

void State::add_clone(std::uint64_t id, TimeNs image_stamp_ns, bool keyframe,
                      const Eigen::Vector3d& rate_imu) {
  const int offset = clone_offset(static_cast<int>(clones_.size()));
  insert_rows(offset, 6);
  // clone = imu pose, so its rows repeat the IMU's ...
  const auto copy_rows = [&](int to, int from) {
    P_.block(to, 0, 3, dimension_) = P_.block(from, 0, 3, dimension_);
  };
  copy_rows(offset, kPosition);
  copy_rows(offset + 3, kRotation);
  if (time_offset_offset_ >= 0) {
    // ... and move with the time offset: the image was taken at stamp + offset.
    const Eigen::RowVectorXd offset_row = P_.row(time_offset_offset_).head(dimension_);
    P_.block(offset, 0, 3, dimension_) += imu_.v_world_imu * offset_row;
    P_.block(offset + 3, 0, 3, dimension_) += rate_imu * offset_row;
  }
  const auto copy_columns = [&](int to, int from) {
    P_.block(0, to, dimension_, 3) = P_.block(0, from, dimension_, 3);
  };
  copy_columns(offset, kPosition);
  copy_columns(offset + 3, kRotation);
  if (time_offset_offset_ >= 0) {
    const Eigen::VectorXd offset_column = P_.col(time_offset_offset_).head(dimension_);
    P_.block(0, offset, dimension_, 3) += offset_column * imu_.v_world_imu.transpose();
    P_.block(0, offset + 3, dimension_, 3) += offset_column * rate_imu.transpose();
  }
  clones_.push_back({id, image_stamp_ns, keyframe, imu_.pose, imu_first_.pose});
}

void State::remove_clone(int index) {
  remove_rows(clone_offset(index), 6);
  clones_.erase(clones_.begin() + index);
}

void State::add_landmark(const SlamLandmark& landmark, const Eigen::MatrixXd& cross,
                         const Eigen::Matrix3d& own) {
  assert(cross.cols() == dimension_ && cross.rows() == 3);
  const int offset = dimension_;
  assert(offset + 3 <= capacity());
  P_.block(offset, 0, 3, offset) = cross;
  P_.block(0, offset, offset, 3) = cross.transpose();
  P_.block<3, 3>(offset, offset) = own;
  dimension_ += 3;
  landmarks_.push_back(landmark);
}

void State::remove_landmark(int index) {
  remove_rows(landmark_offset(index), 3);
  landmarks_.erase(landmarks_.begin() + index);
}

void State::reanchor_landmark(int index, const SlamLandmark& moved, const Eigen::MatrixXd& J) {
  const int offset = landmark_offset(index);
  const Eigen::MatrixXd cross = J * covariance();
  const Eigen::Matrix3d own = cross * J.transpose();
  P_.block(offset, 0, 3, dimension_) = cross;
  P_.block(0, offset, dimension_, 3) = cross.transpose();
  P_.block<3, 3>(offset, offset) = (own + own.transpose()) / 2;
  landmarks_[static_cast<std::size_t>(index)] = moved;
}

void State::count_gated(int landmark_index, bool gated) {
  int& count = landmarks_[static_cast<std::size_t>(landmark_index)].gated_in_a_row;
  count = gated ? count + 1 : 0;
}

void State::forget_first_estimates() {
  imu_first_ = imu_;
  for (Clone& clone : clones_) clone.first = clone.pose;
  for (SlamLandmark& landmark : landmarks_) landmark.first = landmark.inverse_depth;
}

Eigen::VectorXd State::window_minus(const State& other) const {
  Eigen::VectorXd difference(calibration_size_ + 6 * static_cast<int>(clones_.size()));
  const auto rotation = [](const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) {
    return log_quaternion(from.conjugate() * to);
  };
  int row = 0;
  if (extrinsics_offset_ >= 0) {
    difference.head<3>() = extrinsics_.p_imu_cam - other.extrinsics_.p_imu_cam;
    difference.segment<3>(3) = rotation(other.extrinsics_.q_imu_cam, extrinsics_.q_imu_cam);
    row = 6;
  }
  if (time_offset_offset_ >= 0) {
    difference(row++) = extrinsics_.time_offset_s - other.extrinsics_.time_offset_s;
  }
  if (intrinsics_offset_ >= 0) {
    difference.segment<kIntrinsicsSize>(row) = intrinsics_error_ - other.intrinsics_error_;
    row += kIntrinsicsSize;
  }
  for (std::size_t i = 0; i < clones_.size(); ++i, row += 6) {
    const Pose& from = other.clones_[i].pose;
    difference.segment<3>(row) = clones_[i].pose.p_world_imu - from.p_world_imu;
    difference.segment<3>(row + 3) = rotation(from.q_world_imu, clones_[i].pose.q_world_imu);
  }
  return difference;
}

void State::correct(const Eigen::VectorXd& dx, const Eigen::Ref<const Eigen::MatrixXd>& W) {
  auto P = P_.topLeftCorner(dimension_, dimension_);
  P.selfadjointView<Eigen::Lower>().rankUpdate(W, -1.0);
  mirror_lower();
  apply(dx);
}

void State::correct(const Eigen::VectorXd& dx, const Eigen::MatrixXd& G, const Eigen::MatrixXd& D) {
  auto P = P_.topLeftCorner(dimension_, dimension_);
  const Eigen::MatrixXd GD = G * D;
  P.triangularView<Eigen::Lower>() -= GD * G.transpose();
  mirror_lower();
  apply(dx);
}

void State::mirror_lower() {
  for (int column = 1; column < dimension_; ++column) {
    P_.col(column).head(column) = P_.row(column).head(column).transpose();
  }
}

void State::apply(const Eigen::VectorXd& dx) {
  assert(dx.size() == dimension_);
  imu_.pose.p_world_imu += dx.segment<3>(kPosition);
  imu_.v_world_imu += dx.segment<3>(kVelocity);
  rotate_locally(imu_.pose.q_world_imu, dx.segment<3>(kRotation));
  imu_.gyro_bias += dx.segment<3>(kGyroBias);
  imu_.accel_bias += dx.segment<3>(kAccelBias);
  if (extrinsics_offset_ >= 0) {
    extrinsics_.p_imu_cam += dx.segment<3>(extrinsics_offset_);
    rotate_locally(extrinsics_.q_imu_cam, dx.segment<3>(extrinsics_offset_ + 3));
  }
  if (time_offset_offset_ >= 0) extrinsics_.time_offset_s += dx(time_offset_offset_);
  if (intrinsics_offset_ >= 0) intrinsics_error_ += dx.segment<kIntrinsicsSize>(intrinsics_offset_);
  for (std::size_t i = 0; i < clones_.size(); ++i) {
    const int offset = clone_offset(static_cast<int>(i));
    clones_[i].pose.p_world_imu += dx.segment<3>(offset);
    rotate_locally(clones_[i].pose.q_world_imu, dx.segment<3>(offset + 3));
  }
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    landmarks_[i].inverse_depth += dx.segment<3>(landmark_offset(static_cast<int>(i)));
  }
}

void State::insert_rows(int offset, int size) {
  assert(dimension_ + size <= capacity());
  for (int column = 0; column < dimension_; ++column) {
    double* data = P_.col(column).data();
    std::copy_backward(data + offset, data + dimension_, data + dimension_ + size);
  }
  for (int column = dimension_ - 1; column >= offset; --column) {
    P_.col(column + size).head(dimension_ + size) = P_.col(column).head(dimension_ + size);
  }
  dimension_ += size;
}

void State::remove_rows(int offset, int size) {
  for (int column = offset + size; column < dimension_; ++column) {
    P_.col(column - size).head(dimension_) = P_.col(column).head(dimension_);
  }
  dimension_ -= size;
  for (int column = 0; column < dimension_; ++column) {
    double* data = P_.col(column).data();
    std::copy(data + offset + size, data + dimension_ + size, data + offset);
  }
}

}  // namespace covey
