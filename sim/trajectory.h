// SPDX-License-Identifier: Apache-2.0
//
// The true motion of a drone: uniform B-splines of order 6 for position (R3) and attitude (SO(3),
// cumulative), so that velocity, acceleration, angular rate and angular acceleration are the exact
// derivatives of the pose and continuous.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <functional>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

struct KinematicState {
  Pose pose;
  Eigen::Vector3d v_world_imu = Eigen::Vector3d::Zero();  // m/s
  Eigen::Vector3d a_world_imu = Eigen::Vector3d::Zero();  // m/s2, without gravity
  Eigen::Vector3d omega_imu = Eigen::Vector3d::Zero();    // rad/s
  Eigen::Vector3d alpha_imu = Eigen::Vector3d::Zero();    // rad/s2
};

// What a multirotor can be told to do freely; its tilt follows (Mellinger and Kumar, 2011).
struct FlatOutput {
  Eigen::Vector3d p_world_imu = Eigen::Vector3d::Zero();  // m
  double yaw = 0;  // rad, heading to which the imu's y axis is normal
};
using FlatPath =
    std::function<FlatOutput(double time_s)>;  // also asked a little outside the flight

class Trajectory {
 public:
  static constexpr int kOrder = 6;

  // Control points of position and attitude at the same knots, at least kOrder of them. Lasts
  // (count - 5) knot intervals.
  Trajectory(double knot_interval_s, std::vector<Eigen::Vector3d> positions,
             std::vector<Eigen::Quaterniond> attitudes);

  // Recorded motion, smoothed: least squares on knots `knot_interval_s` apart plus a slight penalty
  // on jerk. Times increase strictly; time 0 of the trajectory is times_s.front(). Knots should not
  // be closer than the poses. 0.1 s keeps the recording's noise out of a simulated IMU; 0.05 s
  // follows the poses closer, as is wanted beside a recorded IMU.
  static Trajectory from_poses(const std::vector<double>& times_s, const std::vector<Pose>& poses,
                               double knot_interval_s = 0.1);

  // A multirotor that flies `path`: body z along the thrust (acceleration minus gravity), body y
  // normal to the heading. Motion much faster than the knots is smoothed away.
  static Trajectory multirotor(const FlatPath& path, double duration_s,
                               double knot_interval_s = 0.1);

  // Times outside [0, duration] give the nearest end.
  [[nodiscard]] KinematicState at(double time_s) const;
  [[nodiscard]] Pose pose_at(double time_s) const;
  [[nodiscard]] double duration_s() const { return duration_s_; }

  // The same motion, ended early (or unchanged when it is shorter).
  [[nodiscard]] Trajectory first_seconds(double duration_s) const;

  // Path length, m, between two times.
  [[nodiscard]] double length_m(double from_s, double to_s) const;

 private:
  struct Segment {
    std::size_t first = 0;  // control point
    double u = 0;           // place within the knot interval, 0..1
  };
  [[nodiscard]] Segment segment_at(double time_s) const;

  double knot_interval_s_;
  double duration_s_;
  std::vector<Eigen::Vector3d> positions_;
  std::vector<Eigen::Quaterniond> attitudes_;
  std::vector<Eigen::Vector3d> rotations_;  // from each attitude to the next, local, rad
};

}  // namespace covey
