// SPDX-License-Identifier: Apache-2.0
#include "apps/earlier_flight.h"

#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "apps/agent.h"
#include "apps/run_files.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

// By the first two others see whether a flight goes on or has ended.
std::vector<std::string> flight_files() {
  std::vector<std::string> files = {kAgentSummaryFile, kAgentStatusFile};
  files.insert(files.end(), std::begin(kRunFiles), std::end(kRunFiles));
  return files;
}

// Every trajectory has its header line.
bool has_flown(const fs::path& folder) {
  std::ifstream trajectory(folder / kTrajectoryFile);
  std::string header, pose;
  return std::getline(trajectory, header) && std::getline(trajectory, pose);
}

fs::path next_free(const fs::path& earlier) {
  int number = 1;
  while (fs::exists(earlier / std::to_string(number))) ++number;
  return earlier / std::to_string(number);
}

}  // namespace

std::optional<fs::path> set_aside_earlier_flight(const fs::path& folder) {
  std::optional<fs::path> earlier;
  if (has_flown(folder)) {
    earlier = next_free(folder / "earlier");
    fs::create_directories(*earlier);
  }
  for (const std::string& file : flight_files()) {
    if (!fs::exists(folder / file)) continue;
    if (earlier)
      fs::rename(folder / file, *earlier / file);
    else
      fs::remove(folder / file);
  }
  return earlier;
}

}  // namespace covey
