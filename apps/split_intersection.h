// SPDX-License-Identifier: Apache-2.0
//
// Split covariance intersection (Julier and Uhlmann, Handbook of Multisensor Data Fusion, 2001), to
// compare the drift filter with: a drone keeps its own drift alone and tells others its corrected
// poses. What a peer says of itself may hang together with what is known here in any way; how the
// two cameras stand to each other was measured independently of both.
#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "estimator/drift_step.h"
#include "estimator/measurements.h"
#include "estimator/relative_pose.h"

namespace covey {

// Of the odometry's error at a keyframe.
struct DriftEstimate {
  Vector6d mean = Vector6d::Zero();
  Matrix6d covariance = Matrix6d::Identity();
};

class SplitIntersection {
 public:
  // Every own keyframe, as the odometry has it.
  void add_own(const KeyframePose& pose);
  // What was known at that own keyframe; nothing if there was none.
  [[nodiscard]] std::optional<DriftEstimate> at(std::uint64_t keyframe_id) const;
  // `measurement.own` is the newest own keyframe, `other` what is known at the other one. False:
  // beyond the gate, or it adds nothing.
  bool fuse(const RelativePose& measurement, const DriftEstimate& other);
  // The odometry's output with the present drift taken out.
  [[nodiscard]] Odometry corrected(const Odometry& alone) const;

 private:
  std::optional<KeyframePose> newest_;
  DriftEstimate drift_;                          // at the newest keyframe
  std::map<std::uint64_t, DriftEstimate> past_;  // by keyframe
};

}  // namespace covey
