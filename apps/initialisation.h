// SPDX-License-Identifier: Apache-2.0
//
// Where a drone starts: from its ground truth, or from standing still.
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "apps/config_file.h"
#include "apps/dataset.h"
#include "estimator/initializer.h"

namespace covey {

class Initialisation {
 public:
  // Throws if ground truth is asked for and there is none.
  Initialisation(const InitialisationConfig& config, double gravity,
                 std::optional<GroundTruth> truth);

  // `imu`: samples up to `imu_stamp_ns`, the image's moment on the IMU clock; at least the last
  // `history_s` of them, or all there are.
  [[nodiscard]] std::variant<InitialState, NotStill> start_at(
      TimeNs imu_stamp_ns, const std::vector<ImuSample>& imu) const;

  [[nodiscard]] double history_s() const { return static_.window_s; }
  // Whether ground truth tells where it starts.
  [[nodiscard]] bool has_truth() const { return truth_.has_value(); }

 private:
  [[nodiscard]] std::variant<InitialState, NotStill> from_truth(TimeNs imu_stamp_ns) const;
  [[nodiscard]] std::variant<InitialState, NotStill> from_standing_still(
      TimeNs imu_stamp_ns, const std::vector<ImuSample>& imu) const;

  InitialisationConfig config_;
  StaticInitConfig static_;
  std::optional<GroundTruth> truth_;
};

// At the pose's position, turned by its yaw, level.
[[nodiscard]] Eigen::Isometry3d level_frame_at(const Pose& pose);

// The same start in the world whose place in the present one is `T_world_own`, a level frame.
[[nodiscard]] InitialState seen_from(const Eigen::Isometry3d& T_world_own, InitialState start);

}  // namespace covey
