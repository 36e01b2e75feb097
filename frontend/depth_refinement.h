// SPDX-License-Identifier: Apache-2.0
//
// A track that is seen for longer gets a better depth, and the keyframes that saw it before can
// have it: what they tell a peer later on is surer than what was known when they were taken.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <optional>

#include "estimator/measurements.h"

namespace covey {

struct InverseDepth {
  double value = 0, sigma = 0;  // 1/m
};

// Of what another camera sees at `bearing` with inverse depth `there`, in this camera. Nothing if
// it is not known or lies behind this one.
[[nodiscard]] std::optional<InverseDepth> depth_in(const Eigen::Isometry3d& T_this_other,
                                                   const Eigen::Vector2d& bearing,
                                                   const InverseDepth& there);

// The end, `before` or `newer`, of the way on which most depths of `older` have been measured now.
[[nodiscard]] KeyframePose measured_on_the_way_to(const KeyframePose& older,
                                                  const KeyframePose& before,
                                                  const KeyframePose& newer, int known,
                                                  int refined);

// What the newer keyframe knows of the tracks that both see goes into the older one, as far as it
// is surer. Where that were most of its landmarks, their depths have been measured on the way from
// one to the other, if it is longer than the way since `before`: then that is the newer one.
// Features rise by `order`, which is one for one track.
template <typename Keyframe, typename Order>
void refine_depths(Keyframe& older, const Keyframe& newer, const Order& order) {
  const Eigen::Isometry3d T_older_newer = older.pose.T_world_cam.inverse() * newer.pose.T_world_cam;
  int known = 0, refined = 0;
  auto seen = newer.features.begin();
  for (auto& feature : older.features) {
    known += feature.inverse_depth > 0 ? 1 : 0;
    while (seen != newer.features.end() && order(*seen) < order(feature)) ++seen;
    if (seen == newer.features.end() || seen->track_id != feature.track_id) continue;
    const std::optional<InverseDepth> depth =
        depth_in(T_older_newer, seen->bearing, {seen->inverse_depth, seen->inverse_depth_sigma});
    if (!depth) continue;
    if (feature.inverse_depth > 0 && depth->sigma >= feature.inverse_depth_sigma) continue;
    feature.inverse_depth = depth->value;
    feature.inverse_depth_sigma = depth->sigma;
    ++refined;
  }
  older.before = measured_on_the_way_to(older.pose, older.before, newer.pose, known, refined);
}

// The newest `count` of keyframes that rise with time.
template <typename Keyframes, typename Keyframe, typename Order>
void refine_newest(Keyframes& keyframes, std::size_t count, const Keyframe& newer,
                   const Order& order) {
  const std::size_t kept = keyframes.size() - std::min(keyframes.size(), count);
  for (std::size_t i = kept; i < keyframes.size(); ++i) refine_depths(keyframes[i], newer, order);
}

}  // namespace covey
