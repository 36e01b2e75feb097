// SPDX-License-Identifier: Apache-2.0
//
// What `covey lab` leaves in its folder besides the flights: cells.csv, summary.json, report.html.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/lab_experiment.h"
#include "apps/lab_figures.h"

namespace covey {

struct LabOutcome {
  LabCell cell;
  LabFigures figures;
};

// All three, of what has been flown so far.
void write_lab_results(const std::filesystem::path& out, const LabExperiment& experiment,
                       const std::vector<LabOutcome>& outcomes);

// One line per setting, means over seeds and repeats.
[[nodiscard]] std::string lab_table(const std::vector<LabOutcome>& outcomes);

}  // namespace covey
