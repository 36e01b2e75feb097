// SPDX-License-Identifier: Apache-2.0
#include "apps/place_report.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/chart_sheet.h"
#include "apps/folder_entries.h"
#include "apps/json_file.h"
#include "apps/svg.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

using Json = nlohmann::json;

constexpr double kChartWidth = 300, kChartHeight = 230;  // px

struct DescriptorStyle {
  const char* name;
  const char* label;
  const char* color;  // of report_style.h
};
constexpr std::array<DescriptorStyle, 4> kStyles = {{
    {"paper", "paper's OR-VLAD", "series-d"},
    {"majority", "majority VLAD", "series-b"},
    {"bag", "bag of words", "series-e"},
    {"compact", "compact corners", "series-a"},
}};

const DescriptorStyle& style_of(const DescriptorResult& result) {
  return *std::find_if(kStyles.begin(), kStyles.end(),
                       [&](const DescriptorStyle& style) { return result.name == style.name; });
}

Json to_json(const DescriptorResult& result) {
  return {{"mean_bytes", result.mean_bytes},
          {"average_precision", result.figures.average_precision},
          {"recall_at_full_precision", result.figures.recall_at_full_precision},
          {"first_is_right", result.first_is_right}};
}

Json to_json(const DatasetComparison& comparison) {
  Json json = {{"views", comparison.views},
               {"pairs_same_place", comparison.same},
               {"pairs_other_place", comparison.different}};
  for (const DescriptorResult& result : comparison.descriptors) {
    json["descriptors"][result.name] = to_json(result);
  }
  return json;
}

std::string curves_csv(const std::vector<DatasetComparison>& comparisons) {
  std::string csv = "dataset,descriptor,threshold,precision,recall\n";
  for (const DatasetComparison& comparison : comparisons) {
    for (const DescriptorResult& result : comparison.descriptors) {
      for (const OperatingPoint& point : result.figures.curve) {
        char numbers[96];
        std::snprintf(numbers, sizeof numbers, ",%.6g,%.5f,%.5f\n", point.threshold,
                      point.precision, point.recall);
        csv += comparison.dataset + "," + result.name + numbers;
      }
    }
  }
  return csv;
}

Chart chart_of(const DatasetComparison& comparison) {
  Chart chart;
  chart.title = comparison.dataset;
  chart.x_label = "recall";
  chart.y_label = "precision";
  chart.width_px = kChartWidth;
  chart.height_px = kChartHeight;
  chart.x_range = chart.y_range = AxisRange{0, 1.02};
  for (const DescriptorResult& result : comparison.descriptors) {
    Curve curve;
    curve.label = style_of(result).label;
    curve.color = style_of(result).color;
    curve.width_px = result.name == "compact" ? 2.4 : 1.6;
    for (const OperatingPoint& point : result.figures.curve) {
      if (curve.points.empty()) curve.points.emplace_back(0, point.precision);
      curve.points.emplace_back(point.recall, point.precision);
    }
    chart.curves.push_back(std::move(curve));
  }
  return chart;
}

// The same descriptors everywhere: those of the first dataset.
std::string drawing_of(const std::vector<DatasetComparison>& comparisons) {
  std::vector<SheetEntry> legend;
  for (const DescriptorResult& result : comparisons.front().descriptors) {
    legend.push_back({style_of(result).label, style_of(result).color});
  }
  std::vector<Chart> charts;
  charts.reserve(comparisons.size());
  for (const DatasetComparison& comparison : comparisons) charts.push_back(chart_of(comparison));
  return chart_sheet(charts, legend);
}

}  // namespace

void write_place_report(const std::filesystem::path& folder,
                        const std::vector<DatasetComparison>& comparisons) {
  Json json;
  for (const DatasetComparison& comparison : comparisons) {
    json[comparison.dataset] = to_json(comparison);
  }
  write_json_file(folder / "places.json", json);
  write_whole_file(folder / "curves.csv", curves_csv(comparisons));
  write_whole_file(folder / "places.svg", drawing_of(comparisons));
}

bool is_place_report(const std::filesystem::path& folder) {
  return holds_exactly(folder, {"places.json", "curves.csv", "places.svg"});
}

std::string place_table(const std::vector<DatasetComparison>& comparisons) {
  char line[256];
  std::snprintf(line, sizeof line, "%-16s %-10s %7s %10s %10s %10s\n", "dataset", "descriptor",
                "bytes", "avg prec.", "recall@100", "1st right");
  std::string table = line;
  for (const DatasetComparison& comparison : comparisons) {
    for (const DescriptorResult& result : comparison.descriptors) {
      std::snprintf(line, sizeof line, "%-16s %-10s %7.0f %10.3f %10.3f %10.3f\n",
                    comparison.dataset.c_str(), result.name.c_str(), result.mean_bytes,
                    result.figures.average_precision, result.figures.recall_at_full_precision,
                    result.first_is_right);
      table += line;
    }
  }
  return table;
}

}  // namespace covey
