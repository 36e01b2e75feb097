// SPDX-License-Identifier: Apache-2.0
//
// A whole experiment: alone once, then every cell over a network of its own. Cells that an earlier
// run has finished are not flown again.
#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "apps/lab_experiment.h"
#include "apps/lab_report.h"

namespace covey {

struct LabProgress {
  std::string doing;                // "alone", or the cell's name
  std::size_t cell = 0;             // from 1 on; 0 before the first
  std::size_t cells = 0;            // to be flown in this run
  double flown_s = 0, total_s = 0;  // of this flight
  double elapsed_s = 0;             // in cells, since the first began
};

struct LabOptions {
  LabExperiment experiment;
  std::filesystem::path experiment_file;  // in errors
  std::filesystem::path dataset;
  std::filesystem::path out;
};

// What depends on the dataset. Throws std::runtime_error naming what is wrong.
void check_lab(const LabOptions& options);

// Checks that as well, then flies. Throws std::runtime_error naming what is wrong.
// Ctrl-C ends it in good order: what was finished is in the results.
std::vector<LabOutcome> run_lab(const LabOptions& options,
                                const std::function<void(const LabProgress&)>& on_progress);

}  // namespace covey
