// SPDX-License-Identifier: Apache-2.0
#include "apps/recorded_flight.h"

#include "apps/dataset.h"

namespace covey {

RecordedFlight read_recorded_flight(const std::filesystem::path& ground_truth_csv,
                                    const std::filesystem::path& imu_csv) {
  RecordedFlight flight;
  for (const GroundTruthState& state : read_ground_truth(ground_truth_csv).states)
    flight.states.push_back(
        {state.stamp_ns, state.pose, state.v_world_imu, state.gyro_bias, state.accel_bias});
  if (!imu_csv.empty()) flight.imu = read_imu(imu_csv);
  return flight;
}

}  // namespace covey
