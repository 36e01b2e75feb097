// SPDX-License-Identifier: Apache-2.0
//
// Where a peer's world lies in the own one when the two have not started together: every relative
// pose of common keyframes says so, and is wrong when two places look alike. A world is believed
// once several agree whose views differ enough to show different things, and once they are most of
// what was said.
#pragma once

#include <Eigen/Geometry>
#include <vector>

#include "estimator/relative_pose.h"

namespace covey {

struct WorldVoteConfig {
  int votes = 4;               // relative poses of different keyframes that must agree
  double spread = 0.4;         // rad, view_difference of the own views that differ most
  double agree_m = 0.5;        // m, at the peer's camera
  double agree_rad = 0.03;     // rad of yaw
  double max_tilt_rad = 0.05;  // rad, between two worlds whose gravity is one
  double share = 0.6;          // of all candidates, those that agree
};

// The peer's world in the own one as one relative pose has it, no drift taken out.
[[nodiscard]] Eigen::Isometry3d world_of(const RelativePose& measurement);

// Turned about gravity alone so as to be nearest to `T`, and the same at the peer's `p_peer`.
[[nodiscard]] Eigen::Isometry3d levelled(const Eigen::Isometry3d& T, const Eigen::Vector3d& p_peer);

class WorldVote {
 public:
  // Those that agree, oldest first, once that is enough; everything is forgotten then. Else
  // nothing. No two are of one keyframe: the newest is left out if it repeats one.
  [[nodiscard]] std::vector<RelativePose> add(const WorldVoteConfig& config,
                                              const RelativePose& measurement);

 private:
  std::vector<RelativePose> candidates_;  // oldest first
};

}  // namespace covey
