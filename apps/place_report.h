// SPDX-License-Identifier: Apache-2.0
//
// What `covey places` leaves in its folder:
//
//   places.json    average precision, recall at full precision, bytes: per dataset and descriptor;
//                  datasets are called as their folders, with those above as far as it takes to
//                  tell them apart (dataset_names)
//   curves.csv     dataset, descriptor, threshold, precision, recall
//   places.svg     the curves, one chart for each dataset
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/place_comparison.h"

namespace covey {

// Into a folder that is there. Throws std::runtime_error naming what cannot be written.
void write_place_report(const std::filesystem::path& folder,
                        const std::vector<DatasetComparison>& comparisons);

// Whether a folder holds what it writes and nothing else.
[[nodiscard]] bool is_place_report(const std::filesystem::path& folder);

// For the terminal, a line for each dataset and descriptor.
[[nodiscard]] std::string place_table(const std::vector<DatasetComparison>& comparisons);

}  // namespace covey
