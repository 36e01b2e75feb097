// SPDX-License-Identifier: Apache-2.0
//
// All that a filter knows at one image, as the paper's drones tell it to each other ("the tracks,
// the state, and the covariance", section on communication). Covey's compact exchange sends none of
// it.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

// M clones and N landmarks; the sizes tell how many.
struct FilterSnapshot {
  TimeNs stamp_ns = 0;  // of the IMU's pose
  // Nominal values, quaternions as x, y, z, w, SI units:
  //   IMU          p_world_imu v_world_imu q_world_imu gyro_bias accel_bias   16
  //   calibration  p_imu_cam q_imu_cam time_offset                            8
  //   clones       p_world_imu q_world_imu                                    7 M
  //   landmarks    (x/z, y/z, 1/z) in the camera of the anchor                3 N
  Eigen::VectorXd state;
  std::vector<std::uint64_t> landmark_tracks;  // N, TrackObservation::track_id
  std::vector<std::uint8_t> landmark_anchors;  // N, which clone
  // Of the error state, in its order (state.h), symmetric: 15 + c + 6 M + 3 N rows, where c = 0, 1,
  // 6 or 7 is how much of the calibration above is estimated. The camera's intrinsics stay at home.
  Eigen::MatrixXd covariance;
};

// A peer's keyframe and, of the same image, its filter (the paper's MessageUAV).
struct FullPeerKeyframe {
  PeerKeyframe keyframe;  // receiver empty: for every drone
  FilterSnapshot filter;
};

}  // namespace covey
