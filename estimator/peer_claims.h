// SPDX-License-Identifier: Apache-2.0
//
// How sure a peer is believed to be: of its odometry, and of own keyframes that it says to have
// found. Claims are measured by what the own drone manages.
#pragma once

#include <deque>

#include "estimator/measurements.h"
#include "estimator/relative_pose.h"

namespace covey {

struct PeerClaimsConfig {
  // A peer's claim to drift less than this share of the own odometry over the same time is not
  // believed (variances), nor one to have found a keyframe that much more exactly than the own
  // drone usually does.
  double least_claim = 0.5;
  // What a peer says to have found of the own landmarks is not verified here: it counts as at least
  // that uncertain (standard deviations, added).
  double found_position_sigma_m = 0.001;  // m
  double found_angle_sigma = 1e-4;        // rad
};

class PeerClaims {
 public:
  explicit PeerClaims(const PeerClaimsConfig& config) : config_(config) {}

  // Every own keyframe: how sure the own odometry was at what time.
  void add_own(const KeyframePose& pose);
  // A relative pose that was used: those that the own drone finds show what is usual.
  void learn_usual(const RelativePose& used);

  // Of a peer's odometry, with the covariance that is believed.
  [[nodiscard]] Matrix6d believable(const KeyframePose& peer) const;
  [[nodiscard]] RelativePose believable(RelativePose measurement) const;

 private:
  struct OwnDrift {
    TimeNs stamp_ns = 0;
    double position = 0, yaw = 0;  // variances, m2 and rad2
  };
  // How sure the relative poses are that the own drone finds: means of the variances' logarithms.
  struct UsualFound {
    int count = 0;
    double log_position = 0, log_angle = 0;  // m2 and rad2, sums over the three axes
  };

  PeerClaimsConfig config_;
  std::deque<OwnDrift> own_history_;  // rising stamps
  UsualFound usual_found_;
};

}  // namespace covey
