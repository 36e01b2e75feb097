// SPDX-License-Identifier: Apache-2.0
#include "sim/trajectory.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "estimator/so3.h"
#include "sim/bspline.h"

namespace covey {

static_assert(Trajectory::kOrder == bspline::kOrder);

Trajectory::Trajectory(double knot_interval_s, std::vector<Eigen::Vector3d> positions,
                       std::vector<Eigen::Quaterniond> attitudes)
    : knot_interval_s_(knot_interval_s),
      duration_s_(0),
      positions_(std::move(positions)),
      attitudes_(std::move(attitudes)) {
  if (!(knot_interval_s > 0) || positions_.size() != attitudes_.size() ||
      positions_.size() < static_cast<std::size_t>(kOrder)) {
    throw std::runtime_error(
        "trajectory: needs a positive knot interval and as many positions as attitudes, at least "
        "6");
  }
  duration_s_ = static_cast<double>(positions_.size() - (kOrder - 1)) * knot_interval_s_;
  rotations_.reserve(attitudes_.size() - 1);
  for (std::size_t i = 0; i + 1 < attitudes_.size(); ++i) {
    rotations_.push_back(log_quaternion(attitudes_[i].conjugate() * attitudes_[i + 1]));
  }
}

Trajectory::Segment Trajectory::segment_at(double time_s) const {
  const double knots = std::clamp(time_s, 0.0, duration_s_) / knot_interval_s_;
  const std::size_t last = positions_.size() - kOrder;
  const std::size_t first = std::min(static_cast<std::size_t>(knots), last);
  return {first, knots - static_cast<double>(first)};
}

// Sommer et al., "Efficient derivative computation for cumulative B-splines on Lie groups" (2020):
// each factor Exp(lambda_j d_j) turns the rates gathered so far into its own frame and adds its
// own.
KinematicState Trajectory::at(double time_s) const {
  const Segment segment = segment_at(time_s);
  const bspline::Weights w = bspline::cumulative_weights(segment.u, knot_interval_s_);
  KinematicState state;
  state.pose.p_world_imu = positions_[segment.first];
  Eigen::Quaterniond q = attitudes_[segment.first];
  for (int j = 1; j < kOrder; ++j) {
    const std::size_t i = segment.first + static_cast<std::size_t>(j);
    const Eigen::Vector3d step = positions_[i] - positions_[i - 1];
    state.pose.p_world_imu += w.value[j] * step;
    state.v_world_imu += w.first[j] * step;
    state.a_world_imu += w.second[j] * step;

    const Eigen::Vector3d& turn = rotations_[i - 1];
    const Eigen::Quaterniond factor = exp_quaternion(w.value[j] * turn);
    const Eigen::Matrix3d R_inverse = factor.toRotationMatrix().transpose();
    q = q * factor;
    state.omega_imu = R_inverse * state.omega_imu + w.first[j] * turn;
    state.alpha_imu =
        R_inverse * state.alpha_imu + w.first[j] * state.omega_imu.cross(turn) + w.second[j] * turn;
  }
  state.pose.q_world_imu = q.normalized();
  return state;
}

Pose Trajectory::pose_at(double time_s) const {
  const Segment segment = segment_at(time_s);
  const bspline::Weights w = bspline::cumulative_weights(segment.u, knot_interval_s_);
  Pose pose{positions_[segment.first], attitudes_[segment.first]};
  for (int j = 1; j < kOrder; ++j) {
    const std::size_t i = segment.first + static_cast<std::size_t>(j);
    pose.p_world_imu += w.value[j] * (positions_[i] - positions_[i - 1]);
    pose.q_world_imu = pose.q_world_imu * exp_quaternion(w.value[j] * rotations_[i - 1]);
  }
  pose.q_world_imu.normalize();
  return pose;
}

Trajectory Trajectory::first_seconds(double duration_s) const {
  Trajectory shorter = *this;
  shorter.duration_s_ = std::clamp(duration_s, 0.0, duration_s_);
  return shorter;
}

double Trajectory::length_m(double from_s, double to_s) const {
  const int steps = std::max(1, static_cast<int>(std::ceil((to_s - from_s) / 0.01)));
  double length = 0;
  Eigen::Vector3d previous = pose_at(from_s).p_world_imu;
  for (int i = 1; i <= steps; ++i) {
    const Eigen::Vector3d p = pose_at(from_s + (to_s - from_s) * i / steps).p_world_imu;
    length += (p - previous).norm();
    previous = p;
  }
  return length;
}

}  // namespace covey
