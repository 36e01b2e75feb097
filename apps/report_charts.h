// SPDX-License-Identifier: Apache-2.0
//
// The charts of the report: run data in, charts out.
#pragma once

#include <string>
#include <vector>

#include "apps/report_data.h"
#include "apps/svg.h"

namespace covey {

// One entry of a legend: the CSS variable of its colour and how it is drawn.
struct LegendEntry {
  enum class Shape { kLine, kDashed, kArea, kDot };
  std::string label;
  std::string color;
  Shape shape = Shape::kLine;
};

struct Legend {
  std::string title;  // of the charts it belongs to; may be empty
  std::vector<LegendEntry> entries;
};

// The colour of a drone, by its place in the run.
[[nodiscard]] std::string drone_color(std::size_t index);

// From above and from two sides, all drones together.
[[nodiscard]] std::vector<Chart> trajectory_charts(const RunData& data);
[[nodiscard]] Legend trajectory_legend(const RunData& data);

// Distance to the truth over time after a yaw and position fit, one chart for each drone on one
// scale.
[[nodiscard]] std::vector<Chart> distance_charts(const RunData& data);
[[nodiscard]] int distance_columns(const RunData& data);
[[nodiscard]] Legend distance_legend(const RunData& data);  // empty when nobody flew alone

// Error along each axis and in yaw with what the filter believes, 3 sigma.
[[nodiscard]] std::vector<Chart> consistency_charts(const AgentRun& agent);
[[nodiscard]] Legend consistency_legend();

[[nodiscard]] std::vector<Chart> work_charts(const AgentRun& agent);
[[nodiscard]] std::vector<Legend> work_legends(const RunData& data);

// Adds a curve for each chain: after a shutter event nothing leads on from what was before.
void add_chains(const std::vector<PhotometricRecord>& records, TimeNs start_ns, const Curve& like,
                double GainOffset::*value, Chart& chart);

// Of calibrated thermal cameras.
[[nodiscard]] std::vector<Chart> thermal_charts(const AgentRun& agent);
[[nodiscard]] Legend corner_legend(const RunData& data);  // empty when nobody has pictured any
[[nodiscard]] HeatMap field_map(const AgentRun& agent);

[[nodiscard]] std::vector<Chart> link_charts(const AgentRun& agent);
[[nodiscard]] std::vector<Legend> link_legends();

}  // namespace covey
