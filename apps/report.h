// SPDX-License-Identifier: Apache-2.0
//
// report.html: one run on one page, self-contained, drawn as inline SVG.
#pragma once

#include <filesystem>

namespace covey {

// Reads RUN/summary.json and what the drones left in RUN/<agent>/, writes RUN/report.html and
// returns its path. Parts that are missing are left out with a word; a broken file is an error that
// names it.
std::filesystem::path write_report(const std::filesystem::path& run);

}  // namespace covey
