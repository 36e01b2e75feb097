// SPDX-License-Identifier: Apache-2.0
//
// Charts side by side in one SVG file that needs no page around it.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "apps/svg.h"

namespace covey {

struct SheetEntry {
  std::string label;
  std::string color;  // of report_style.h
};

// All as large as the first, `abreast` or less in a row; the legend, if there is one, stands above
// them.
[[nodiscard]] std::string chart_sheet(const std::vector<Chart>& charts,
                                      const std::vector<SheetEntry>& legend,
                                      std::size_t abreast = 3);

}  // namespace covey
