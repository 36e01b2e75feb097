// SPDX-License-Identifier: Apache-2.0
//
// True states of a drone at given stamps: what ground truth files hold, simulated or recorded.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "estimator/measurements.h"
#include "sim/trajectory.h"

namespace covey {

struct TrueState {
  TimeNs stamp_ns = 0;
  Pose pose;
  Eigen::Vector3d v_world_imu = Eigen::Vector3d::Zero();  // m/s
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();    // rad/s
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();   // m/s2
};

// Recorded ground truth that a drone flies again, and the recorded IMU if it keeps that too.
struct RecordedFlight {
  std::vector<TrueState> states;  // at least two, stamps strictly increasing
  std::vector<ImuSample> imu;     // empty: the IMU is simulated
};

// Ends it so long after its first state; `duration_s` 0, or more than it lasts: as it is.
void keep_first_seconds(RecordedFlight& flight, double duration_s);

// Flights from different places share one room: their middles meet, their lowest points too.
void move_into_one_room(std::vector<RecordedFlight>& flights);

// Its motion, smoothed: closer to the recording where its IMU is flown as well.
[[nodiscard]] Trajectory fly_again(const RecordedFlight& flight);

}  // namespace covey
