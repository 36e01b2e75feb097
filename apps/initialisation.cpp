// SPDX-License-Identifier: Apache-2.0
#include "apps/initialisation.h"

#include <spdlog/fmt/fmt.h>

#include <stdexcept>
#include <utility>

namespace covey {

Initialisation::Initialisation(const InitialisationConfig& config, double gravity,
                               std::optional<GroundTruth> truth)
    : config_(config), truth_(std::move(truth)) {
  static_.gravity = gravity;
  if (config_.method == InitMethod::kGroundTruth && !truth_) {
    throw std::runtime_error(
        "initialisation.method is groundtruth, but the dataset has none: set initialisation.method "
        "to static, which starts from standing still");
  }
}

std::variant<InitialState, NotStill> Initialisation::start_at(
    TimeNs imu_stamp_ns, const std::vector<ImuSample>& imu) const {
  return config_.method == InitMethod::kGroundTruth ? from_truth(imu_stamp_ns)
                                                    : from_standing_still(imu_stamp_ns, imu);
}

// Pose and velocity only, as in the paper: the biases are for the filter to find.
std::variant<InitialState, NotStill> Initialisation::from_truth(TimeNs imu_stamp_ns) const {
  const std::optional<TrueState> truth = ground_truth_at(*truth_, imu_stamp_ns);
  if (!truth) {
    return NotStill{fmt::format(
        "the ground truth does not cover this image, or has a hole of more than {} s there",
        kLongestTruthGap_s)};
  }
  InitialState start;
  start.stamp_ns = imu_stamp_ns;
  start.pose = truth->pose;
  start.v_world_imu = truth->v_world_imu;
  start.position_sigma = config_.position_sigma;
  start.yaw_sigma = config_.yaw_sigma;
  start.tilt_sigma = config_.tilt_sigma;
  start.velocity_sigma = config_.velocity_sigma;
  start.gyro_bias_sigma = config_.gyro_bias_sigma;
  start.accel_bias_sigma = config_.accel_bias_sigma;
  return start;
}

std::variant<InitialState, NotStill> Initialisation::from_standing_still(
    TimeNs imu_stamp_ns, const std::vector<ImuSample>& imu) const {
  std::variant<InitialState, NotStill> result =
      static_initialization(imu, config_.p_world_imu, config_.yaw, static_);
  if (const auto* not_still = std::get_if<NotStill>(&result)) {
    return NotStill{
        fmt::format("a drone that starts from standing still has to do so for {} s ({})",
                    static_.window_s, not_still->reason)};
  }
  auto& start = std::get<InitialState>(result);
  start.position_sigma = config_.position_sigma;
  start.yaw_sigma = config_.yaw_sigma;
  if (truth_) {
    const Pose known =
        ground_truth_at(*truth_, imu_stamp_ns).value_or(nearest_state(*truth_, imu_stamp_ns)).pose;
    start.pose.p_world_imu = known.p_world_imu;
    const double yaw = yaw_between(start.pose.q_world_imu, known.q_world_imu);
    start.pose.q_world_imu = turned_about_z(yaw, start.pose.q_world_imu);
  }
  return result;
}

Eigen::Isometry3d level_frame_at(const Pose& pose) {
  Eigen::Isometry3d frame = Eigen::Isometry3d::Identity();
  frame.linear() =
      Eigen::AngleAxisd(heading_of(pose.q_world_imu), Eigen::Vector3d::UnitZ()).toRotationMatrix();
  frame.translation() = pose.p_world_imu;
  return frame;
}

InitialState seen_from(const Eigen::Isometry3d& T_world_own, InitialState start) {
  const Eigen::Isometry3d T_own_world = T_world_own.inverse();
  const Eigen::Quaterniond q_own_world(T_own_world.linear());
  start.pose.p_world_imu = T_own_world * start.pose.p_world_imu;
  start.pose.q_world_imu = (q_own_world * start.pose.q_world_imu).normalized();
  start.v_world_imu = q_own_world * start.v_world_imu;
  return start;
}

}  // namespace covey
