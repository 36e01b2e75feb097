// SPDX-License-Identifier: Apache-2.0
#include "sim/recorded_flight.h"

#include <Eigen/Geometry>
#include <algorithm>

namespace covey {
namespace {

Eigen::AlignedBox3d bounds_of(const RecordedFlight& flight) {
  Eigen::AlignedBox3d box;
  for (const TrueState& state : flight.states) box.extend(state.pose.p_world_imu);
  return box;
}

}  // namespace

void move_into_one_room(std::vector<RecordedFlight>& flights) {
  if (flights.size() < 2) return;
  constexpr double kLowest = 1.0;  // m
  for (RecordedFlight& flight : flights) {
    const Eigen::AlignedBox3d box = bounds_of(flight);
    const Eigen::Vector3d shift(-box.center().x(), -box.center().y(), kLowest - box.min().z());
    for (TrueState& state : flight.states) state.pose.p_world_imu += shift;
  }
}

void keep_first_seconds(RecordedFlight& flight, double duration_s) {
  const TimeNs start_ns = flight.states.front().stamp_ns;
  const TimeNs end_ns =
      duration_s > 0 ? std::min(start_ns + nanoseconds(duration_s), flight.states.back().stamp_ns)
                     : flight.states.back().stamp_ns;
  auto& states = flight.states;
  const auto past_end = [end_ns](const TrueState& s) { return s.stamp_ns > end_ns; };
  // One state beyond the end, so that the motion is known up to it.
  const auto last = std::find_if(states.begin(), states.end(), past_end);
  if (last != states.end()) states.erase(last + 1, states.end());
  auto& imu = flight.imu;
  imu.erase(std::remove_if(imu.begin(), imu.end(),
                           [&](const ImuSample& sample) {
                             return sample.stamp_ns < start_ns || sample.stamp_ns > end_ns;
                           }),
            imu.end());
}

Trajectory fly_again(const RecordedFlight& flight) {
  std::vector<double> times_s;
  std::vector<Pose> poses;
  for (const TrueState& state : flight.states) {
    times_s.push_back(seconds_between(flight.states.front().stamp_ns, state.stamp_ns));
    poses.push_back(state.pose);
  }
  // With the recorded IMU the motion has to be the recorded one as closely as may be.
  return Trajectory::from_poses(times_s, poses, flight.imu.empty() ? 0.1 : 0.05);
}

}  // namespace covey
