// SPDX-License-Identifier: Apache-2.0
//
// What `covey study` leaves in its folder: scaling.{csv,svg} or ablation.csv, and summary.json.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "apps/team_study.h"

namespace covey {

// Into a folder that is there. Throw std::runtime_error naming what cannot be written.
void write_scaling(const std::filesystem::path& folder, const StudyConfig& config,
                   const std::vector<ScalingPoint>& points);
void write_ablation(const std::filesystem::path& folder, const StudyConfig& config,
                    const std::vector<AblationRow>& rows);

// Whether a folder holds what they write and nothing else.
[[nodiscard]] bool is_scaling(const std::filesystem::path& folder);
[[nodiscard]] bool is_ablation(const std::filesystem::path& folder);

// For the terminal.
[[nodiscard]] std::string scaling_table(const std::vector<ScalingPoint>& points);
[[nodiscard]] std::string ablation_table(const std::vector<AblationRow>& rows);

}  // namespace covey
