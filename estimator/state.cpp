// SPDX-License-Identifier: Apache-2.0
#include "estimator/state.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <initializer_list>

#include "estimator/calibration_sigma.h"
#include "estimator/imu_transition.h"
#include "estimator/observation_model.h"
#include "estimator/so3.h"

namespace covey {
namespace {

// How long an acceleration lasts before the scale counts on it, and by how many standard deviations
// another one must stand out of the accelerometer's noise.
constexpr double kTrend_s = 2;
constexpr double kStandsOut = 3;

constexpr int kSpareClones = 2;  // the present image and the last one that was no keyframe

void rotate_locally(Eigen::Quaterniond& q, const Eigen::Vector3d& dtheta) {
  q = (q * exp_quaternion(dtheta)).normalized();
}

}  // namespace

State::State(const EstimatorConfig& config, const ImuState& imu,
             const Eigen::Matrix<double, kImuSize, kImuSize>& imu_covariance)
    : imu_(imu), imu_first_(imu), extrinsics_(config.extrinsics) {
  const auto place = [this](bool estimated, int size) {
    const int offset = estimated ? clones_offset_ : -1;
    if (estimated) clones_offset_ += size;
    return offset;
  };
  extrinsics_offset_ = place(config.calibrate_extrinsics, 6);
  time_offset_offset_ = place(config.calibrate_time_offset, 1);
  intrinsics_offset_ = place(config.calibrate_intrinsics, kIntrinsicsSize);
  const int capacity =
      clones_offset() + 6 * (config.max_clones + kSpareClones) + 3 * config.max_slam_features;
  P_.setZero(capacity, capacity);
  dimension_ = clones_offset();
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
  return {imu_, extrinsics_, intrinsics_error_, metric_covariance(clones_offset())};
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

Eigen::Vector3d State::without_noise(const Eigen::Vector3d& dv, double dt, double noise_variance) {
  if (P_(kScale, kScale) == 0) {  // the scale does not stand by itself: nothing is seen yet
    trend_ = {};
    return dv;
  }
  if (trend_.duration_s > 0) {
    const Eigen::Vector3d seen = (imu_.v_world_imu - trend_.v_world_imu) / trend_.duration_s;
    trend_.a_world_imu += std::min(trend_.duration_s / kTrend_s, 1.0) * (seen - trend_.a_world_imu);
  }
  trend_.v_world_imu = imu_.v_world_imu;
  trend_.duration_s = dt;
  const Eigen::Vector3d expected = trend_.a_world_imu * dt, rest = dv - expected;
  const double noise_share = kStandsOut * kStandsOut * noise_variance / rest.squaredNorm();
  return expected + std::max(0.0, 1 - noise_share) * rest;
}

void State::propagate(const ImuIncrement& increment, TimeNs stamp_ns, double gravity,
                      const ImuNoise& noise) {
  const Eigen::Vector3d g(0, 0, -gravity);
  const ImuState end = carried_over(imu_, increment, stamp_ns, g);
  const auto F = transition(increment, imu_first_, end, g);
  const auto Q = process_noise(increment, imu_.pose.q_world_imu.toRotationMatrix(), noise);
  const double dt = increment.duration_s;
  const Eigen::Vector3d dv = without_noise(end.v_world_imu - imu_.v_world_imu, dt,
                                           Q.block<3, 3>(kVelocity, kVelocity).trace());
  const Eigen::Vector3d& lever = extrinsics_.p_imu_cam;
  const Eigen::Vector3d swing = end.pose.q_world_imu * lever - imu_.pose.q_world_imu * lever;
  const auto F_scale = transition_by_scale(dv, dt, swing);
  const int rest = dimension_ - kImuSize;
  const Eigen::RowVectorXd of_scale = P_.row(kScale).head(dimension_);
  const auto moved = (F * of_scale.head<kImuSize>().transpose()).eval();
  const Eigen::Matrix<double, kImuSize, kImuSize> P_imu = P_.topLeftCorner<kImuSize, kImuSize>();
  P_.topLeftCorner<kImuSize, kImuSize>() = F * P_imu * F.transpose() + F_scale * moved.transpose() +
                                           moved * F_scale.transpose() +
                                           of_scale(kScale) * F_scale * F_scale.transpose() + Q;
  if (rest > 0) {
    P_.block(0, kImuSize, kImuSize, rest) =
        (F * P_.block(0, kImuSize, kImuSize, rest) + F_scale * of_scale.tail(rest)).eval();
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

Eigen::Vector3d State::camera(const Pose& pose) const {
  return camera_pose(pose, extrinsics_).p_world_cam;
}

// d(what is in metres)/d(ds).
Eigen::VectorXd State::change_by_scale() const {
  Eigen::VectorXd D = Eigen::VectorXd::Zero(dimension_);
  D.segment<3>(kPosition) = camera(imu_.pose) - scale_origin_;
  D.segment<3>(kVelocity) = imu_.v_world_imu;
  for (std::size_t i = 0; i < clones_.size(); ++i) {
    D.segment<3>(clone_offset(static_cast<int>(i))) = camera(clones_[i].pose) - scale_origin_;
  }
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    D(landmark_offset(static_cast<int>(i)) + 2) = -landmarks_[i].inverse_depth.z();
  }
  return D;
}

Eigen::MatrixXd State::metric_covariance(int size) const {
  assert(size >= clones_offset());
  const Eigen::VectorXd D = change_by_scale().head(size);
  const Eigen::VectorXd of_scale = P_.col(kScale).head(size);
  Eigen::MatrixXd P = P_.topLeftCorner(size, size);
  P.selfadjointView<Eigen::Lower>().rankUpdate(D, of_scale + of_scale(kScale) / 2 * D);
  P.col(kScale).setZero();
  P.row(kScale).setZero();
  return P.selfadjointView<Eigen::Lower>();
}

// d(what the window's clones are apart by, over its value)/d(error state).
Eigen::RowVectorXd State::common_distance() const {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Clone& clone : clones_) middle += camera(clone.pose);
  middle /= static_cast<double>(clones_.size());
  Eigen::RowVectorXd L = Eigen::RowVectorXd::Zero(dimension_);
  double squared = 0;
  for (std::size_t i = 0; i < clones_.size(); ++i) {
    const Eigen::Vector3d arm = camera(clones_[i].pose) - middle;
    L.segment<3>(clone_offset(static_cast<int>(i))) = arm.transpose();
    squared += arm.squaredNorm();
  }
  return L / squared;
}

// d(mean of -drho/rho)/d(error state).
Eigen::RowVectorXd State::common_depth() const {
  Eigen::RowVectorXd L = Eigen::RowVectorXd::Zero(dimension_);
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    const double rho = landmarks_[i].inverse_depth.z();
    L(landmark_offset(static_cast<int>(i)) + 2) =
        -1 / (rho * static_cast<double>(landmarks_.size()));
  }
  return L;
}

double State::common_depth_sigma() const {
  const int begin = landmark_offset(0), size = dimension_ - begin;
  const Eigen::RowVectorXd L = common_depth().tail(size);
  return std::sqrt((L * P_.block(begin, begin, size, size)).dot(L));
}

// ds = L dx, and dx becomes dx - D ds: as long as ds is zero, dx + u L dx, u having 1 for ds and -D
// for all else.
void State::separate_scale() {
  assert(!landmarks_.empty() || clones_.size() > 1);
  merge_scale();
  scale_origin_ = camera(clones_.front().pose);
  const Eigen::RowVectorXd L = landmarks_.empty() ? common_distance() : common_depth();
  Eigen::VectorXd u = -change_by_scale();
  u(kScale) = 1;
  auto P = P_.topLeftCorner(dimension_, dimension_);
  const Eigen::VectorXd with_all = P * L.transpose();  // covariances of L dx
  const double variance = L * with_all;
  P.selfadjointView<Eigen::Lower>().rankUpdate(u, with_all + variance / 2 * u);
  P = Eigen::MatrixXd(P.selfadjointView<Eigen::Lower>());
}

void State::merge_scale() {
  P_.topLeftCorner(dimension_, dimension_) = metric_covariance(dimension_);
}

// Values and first estimates, and the units of the covariance.
void State::rescale(double ratio) {
  Eigen::VectorXd units = Eigen::VectorXd::Ones(dimension_);
  const auto move = [&](Pose& pose) {
    pose.p_world_imu += (ratio - 1) * (camera(pose) - scale_origin_);
  };
  for (ImuState* imu : {&imu_, &imu_first_}) {
    move(imu->pose);
    imu->v_world_imu *= ratio;
  }
  trend_.v_world_imu *= ratio;
  trend_.a_world_imu *= ratio;
  units.segment<3>(kPosition).setConstant(ratio);
  units.segment<3>(kVelocity).setConstant(ratio);
  for (std::size_t i = 0; i < clones_.size(); ++i) {
    move(clones_[i].pose);
    move(clones_[i].first);
    units.segment<3>(clone_offset(static_cast<int>(i))).setConstant(ratio);
  }
  for (std::size_t i = 0; i < landmarks_.size(); ++i) {
    landmarks_[i].inverse_depth.z() /= ratio;
    landmarks_[i].first.z() /= ratio;
    units(landmark_offset(static_cast<int>(i)) + 2) = 1 / ratio;
  }
  for (int column = 0; column < dimension_; ++column) {
    P_.col(column).head(dimension_).array() *= units.array() * units(column);
  }
}

// By how much faster it flew: the derivative of the clones' corrections, a parabola through each
// three of them. They change smoothly, as the IMU's errors do.
void State::relinearize_time_offset(const State& seen) {
  const int offset = time_offset_offset_;
  if (offset < 0 || clones_.size() < 3) return;
  const auto span_s = [&](std::size_t i) {
    return seconds_between(clones_[i].stamp_ns, clones_[i + 1].stamp_ns);
  };
  const auto slope = [&](std::size_t i) -> Eigen::Vector3d {
    const auto correction = [&](std::size_t at) -> Eigen::Vector3d {
      return seen.clones_[at].pose.p_world_imu - clones_[at].pose.p_world_imu;
    };
    return (correction(i + 1) - correction(i)) / span_s(i);
  };
  for (std::size_t i = 0; i < clones_.size(); ++i) {
    const std::size_t middle = std::clamp<std::size_t>(i, 1, clones_.size() - 2);
    const double left = span_s(middle - 1), right = span_s(middle);
    const Eigen::Vector3d bend = (slope(middle) - slope(middle - 1)) / (left + right);
    const Eigen::Vector3d faster =
        slope(middle) - right * bend +
        2 * seconds_between(clones_[middle].stamp_ns, clones_[i].stamp_ns) * bend;
    const int clone = clone_offset(static_cast<int>(i));
    P_.block(clone, 0, 3, dimension_) += (faster * P_.row(offset).head(dimension_)).eval();
    P_.block(0, clone, dimension_, 3) +=
        (P_.col(offset).head(dimension_) * faster.transpose()).eval();
  }
}

void State::forget_first_estimates() {
  imu_first_ = imu_;
  for (Clone& clone : clones_) clone.first = clone.pose;
  for (SlamLandmark& landmark : landmarks_) landmark.first = landmark.inverse_depth;
}

Eigen::VectorXd State::window_minus(const State& other) const {
  Eigen::VectorXd difference(window_size());
  const auto rotation = [](const Eigen::Quaterniond& from, const Eigen::Quaterniond& to) {
    return log_quaternion(from.conjugate() * to);
  };
  if (extrinsics_offset_ >= 0) {
    const int row = extrinsics_offset_ - kWindow;
    difference.segment<3>(row) = extrinsics_.p_imu_cam - other.extrinsics_.p_imu_cam;
    difference.segment<3>(row + 3) = rotation(other.extrinsics_.q_imu_cam, extrinsics_.q_imu_cam);
  }
  if (time_offset_offset_ >= 0) {
    difference(time_offset_offset_ - kWindow) =
        extrinsics_.time_offset_s - other.extrinsics_.time_offset_s;
  }
  if (intrinsics_offset_ >= 0) {
    difference.segment<kIntrinsicsSize>(intrinsics_offset_ - kWindow) =
        intrinsics_error_ - other.intrinsics_error_;
  }
  for (std::size_t i = 0; i < clones_.size(); ++i) {
    const int row = clone_offset(static_cast<int>(i)) - kWindow;
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
  if (dx(kScale) != 0) rescale(std::exp(dx(kScale)));
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
