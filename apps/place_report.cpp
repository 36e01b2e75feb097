// SPDX-License-Identifier: Apache-2.0
#include "apps/place_report.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "apps/report_style.h"
#include "apps/run_summary.h"
#include "apps/svg.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

using Json = nlohmann::json;

constexpr double kChartWidth = 300, kChartHeight = 230, kLegendHeight = 26;  // px
constexpr std::size_t kChartsAbreast = 3;

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
  chart.x_range = chart.y_range = Range{0, 1.02};
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

std::string open_svg(double x, double y, double width, double height) {
  char text[128];
  std::snprintf(text, sizeof text, "<svg x=\"%.0f\" y=\"%.0f\" width=\"%.0f\" height=\"%.0f\">", x,
                y, width, height);
  return text;
}

// The same descriptors everywhere: those of the first dataset.
std::string legend(const DatasetComparison& comparison, double y) {
  std::string drawing;
  double x = 54;
  for (const DescriptorResult& result : comparison.descriptors) {
    const DescriptorStyle& style = style_of(result);
    char text[256];
    std::snprintf(text, sizeof text,
                  "<line x1=\"%.0f\" y1=\"%.0f\" x2=\"%.0f\" y2=\"%.0f\" "
                  "style=\"stroke:var(--%s);stroke-width:3\"/>"
                  "<text x=\"%.0f\" y=\"%.0f\">%s</text>",
                  x, y, x + 20, y, style.color, x + 26, y + 4, style.label);
    drawing += text;
    x += 150;
  }
  return "<g class=\"chart\">" + drawing + "</g>";
}

std::string drawing_of(const std::vector<DatasetComparison>& comparisons) {
  const std::size_t columns = std::min(kChartsAbreast, comparisons.size());
  const std::size_t rows = (comparisons.size() + columns - 1) / columns;
  const double width = std::max(640.0, kChartWidth * static_cast<double>(columns));
  const double height = kLegendHeight + kChartHeight * static_cast<double>(rows);
  char head[256];
  std::snprintf(head, sizeof head,
                "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" "
                "width=\"%.0f\" height=\"%.0f\" font-family=\"system-ui, sans-serif\">\n",
                width, height, width, height);
  std::string drawing = head + ("<style>" + std::string(kReportStyle)) +
                        "</style>\n<rect width=\"100%\" height=\"100%\" fill=\"var(--card)\"/>\n" +
                        legend(comparisons.front(), kLegendHeight / 2) + "\n";
  for (std::size_t i = 0; i < comparisons.size(); ++i) {
    const std::size_t row = i / columns, column = i % columns;
    drawing += open_svg(kChartWidth * static_cast<double>(column),
                        kLegendHeight + kChartHeight * static_cast<double>(row), kChartWidth,
                        kChartHeight) +
               render_svg(chart_of(comparisons[i])) + "</svg>\n";
  }
  return drawing + "</svg>\n";
}

}  // namespace

void write_place_report(const std::filesystem::path& folder,
                        const std::vector<DatasetComparison>& comparisons) {
  std::filesystem::create_directories(folder);
  Json json;
  for (const DatasetComparison& comparison : comparisons) {
    json[comparison.dataset] = to_json(comparison);
  }
  write_json_file(folder / "places.json", json);
  write_whole_file(folder / "curves.csv", curves_csv(comparisons));
  write_whole_file(folder / "places.svg", drawing_of(comparisons));
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
