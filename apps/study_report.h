// SPDX-License-Identifier: Apache-2.0
//
// What `covey study` leaves in its folder: scaling.{csv,svg} or ablation.csv, and summary.json.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/team_study.h"

namespace covey {

// Make the folder where it is missing. Throw std::runtime_error naming what cannot be written.
void write_scaling(const std::filesystem::path& folder, const StudyConfig& config,
                   const std::vector<ScalingPoint>& points);
void write_ablation(const std::filesystem::path& folder, const StudyConfig& config,
                    const std::vector<AblationRow>& rows);

// For the terminal.
[[nodiscard]] std::string scaling_table(const std::vector<ScalingPoint>& points);
[[nodiscard]] std::string ablation_table(const std::vector<AblationRow>& rows);

}  // namespace covey
