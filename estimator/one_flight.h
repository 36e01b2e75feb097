// SPDX-License-Identifier: Apache-2.0
//
// A drone that starts anew counts its keyframes from the beginning again, and nothing that it said
// in its earlier flight holds any more: not its world, not how its odometry drifts.
#pragma once

namespace covey {

// Can both keyframes be of one flight of a drone? There, ids rise with time. For anything that has
// a keyframe_id and a stamp_ns.
template <typename A, typename B>
[[nodiscard]] bool are_of_one_flight(const A& a, const B& b) {
  return (a.keyframe_id < b.keyframe_id) == (a.stamp_ns < b.stamp_ns) &&
         (a.keyframe_id > b.keyframe_id) == (a.stamp_ns > b.stamp_ns);
}

}  // namespace covey
