// SPDX-License-Identifier: Apache-2.0
#include "apps/recorded_flight.h"

#include "apps/dataset.h"

namespace covey {

RecordedFlight read_recorded_flight(const std::filesystem::path& ground_truth_csv,
                                    const std::filesystem::path& imu_csv) {
  RecordedFlight flight;
  flight.states = read_ground_truth(ground_truth_csv).states;
  if (!imu_csv.empty()) flight.imu = read_imu(imu_csv);
  return flight;
}

}  // namespace covey
