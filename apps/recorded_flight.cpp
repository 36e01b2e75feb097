// SPDX-License-Identifier: Apache-2.0
#include "apps/recorded_flight.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstddef>
#include <stdexcept>

#include "apps/dataset.h"

namespace covey {
namespace {

void drop_before(TimeNs begin_ns, std::vector<TrueState>& states) {
  const auto first = std::find_if(states.begin(), states.end(), [&](const TrueState& state) {
    return state.stamp_ns >= begin_ns;
  });
  states.erase(states.begin(), first);
}

}  // namespace

RecordedFlight read_recorded_flight(const std::filesystem::path& ground_truth_csv,
                                    const std::filesystem::path& imu_csv, double begin_s) {
  RecordedFlight flight;
  flight.states = read_ground_truth(ground_truth_csv).states;
  if (begin_s > 0) {
    const TimeNs start_ns = flight.states.front().stamp_ns, end_ns = flight.states.back().stamp_ns;
    drop_before(start_ns + nanoseconds(begin_s), flight.states);
    if (flight.states.size() < 2) {
      throw std::runtime_error(fmt::format("{}: lasts {:.2f} s and cannot begin at {:g} s",
                                           ground_truth_csv.string(),
                                           seconds_between(start_ns, end_ns), begin_s));
    }
  }
  if (!imu_csv.empty()) flight.imu = read_imu(imu_csv);
  return flight;
}

std::vector<RecordedFlight> read_recorded_flights(const RecordedFiles& files,
                                                  const std::string& command) {
  const std::size_t count = files.trajectories.size();
  const auto require_one_each = [&](const char* option, std::size_t given) {
    if (given > 0 && given != count)
      throw std::runtime_error(
          fmt::format("{}: {} needs one for each --trajectory", command, option));
  };
  require_one_each("--imu", files.imus.size());
  require_one_each("--begin", files.begins_s.size());
  std::vector<RecordedFlight> flights;
  for (std::size_t i = 0; i < count; ++i) {
    flights.push_back(read_recorded_flight(files.trajectories[i],
                                           files.imus.empty() ? std::string() : files.imus[i],
                                           files.begins_s.empty() ? 0 : files.begins_s[i]));
  }
  return flights;
}

}  // namespace covey
