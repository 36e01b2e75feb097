// SPDX-License-Identifier: Apache-2.0
//
// Charts side by side in one SVG file that needs no page around it.
#pragma once

#include <string>
#include <vector>

#include "apps/svg.h"

namespace covey {

struct SheetEntry {
  std::string label;
  std::string color;  // of report_style.h
};

// Three abreast, all as large as the first; the legend stands above them.
[[nodiscard]] std::string chart_sheet(const std::vector<Chart>& charts,
                                      const std::vector<SheetEntry>& legend);

}  // namespace covey
