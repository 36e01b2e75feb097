// SPDX-License-Identifier: Apache-2.0
//
// The paper's tables with our figures beside the printed ones, as one page of Markdown.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/report_data.h"

namespace covey {

// One simulated flight, flown with each exchange.
struct ScenarioResults {
  std::string scenario;  // as covey simulate names it
  std::string seed;
  RunData compact;  // with the drones alone beside it
  RunData paper;
  RunData naive;
  std::optional<RunData> raw;  // of thermal drones: as compact, on images that are not calibrated
};

// Where the figures come from.
struct ResultsOrigin {
  std::string commit;
  std::string machine;
  std::string command;
};

// All folders RUNS/<scenario>-<seed>/ with the runs compact, paper and naive in them, and raw where
// the drones have thermal cameras. Throws std::runtime_error that names the folder that lacks one,
// or if there is none.
[[nodiscard]] std::vector<ScenarioResults> read_results(const std::filesystem::path& runs);

[[nodiscard]] std::string results_page(const std::vector<ScenarioResults>& results,
                                       const ResultsOrigin& origin);

}  // namespace covey
