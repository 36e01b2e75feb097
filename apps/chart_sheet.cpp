// SPDX-License-Identifier: Apache-2.0
#include "apps/chart_sheet.h"

#include <algorithm>
#include <cstddef>
#include <cstdio>

#include "apps/report_style.h"

namespace covey {
namespace {

constexpr double kLegendHeight = 26, kLeastWidth = 640;  // px

std::string open_svg(double x, double y, const Chart& chart) {
  char text[128];
  std::snprintf(text, sizeof text, "<svg x=\"%.0f\" y=\"%.0f\" width=\"%.0f\" height=\"%.0f\">", x,
                y, chart.width_px, chart.height_px);
  return text;
}

std::string drawn(const std::vector<SheetEntry>& legend) {
  constexpr double kFirst = 54, kApart = 150, kMiddle = kLegendHeight / 2;  // px
  std::string drawing;
  double x = kFirst;
  for (const SheetEntry& entry : legend) {
    char line[192];
    std::snprintf(line, sizeof line,
                  "<line x1=\"%.0f\" y1=\"%.0f\" x2=\"%.0f\" y2=\"%.0f\" "
                  "style=\"stroke:var(--%s);stroke-width:3\"/><text x=\"%.0f\" y=\"%.0f\">",
                  x, kMiddle, x + 20, kMiddle, entry.color.c_str(), x + 26, kMiddle + 4);
    drawing += line + escape_html(entry.label) + "</text>";
    x += kApart;
  }
  return "<g class=\"chart\">" + drawing + "</g>";
}

}  // namespace

std::string chart_sheet(const std::vector<Chart>& charts, const std::vector<SheetEntry>& legend,
                        std::size_t abreast) {
  if (charts.empty()) return "";
  const Chart& first = charts.front();
  const std::size_t columns = std::min(abreast, charts.size());
  const std::size_t rows = (charts.size() + columns - 1) / columns;
  const double width = std::max(kLeastWidth, first.width_px * static_cast<double>(columns));
  const double top = legend.empty() ? 0 : kLegendHeight;
  const double height = top + first.height_px * static_cast<double>(rows);
  char head[256];
  std::snprintf(head, sizeof head,
                "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" "
                "width=\"%.0f\" height=\"%.0f\" font-family=\"system-ui, sans-serif\">\n",
                width, height, width, height);
  std::string drawing = head + ("<style>" + std::string(kReportStyle)) +
                        "</style>\n<rect width=\"100%\" height=\"100%\" fill=\"var(--card)\"/>\n" +
                        (legend.empty() ? "" : drawn(legend) + "\n");
  for (std::size_t i = 0; i < charts.size(); ++i) {
    const std::size_t row = i / columns, column = i % columns;
    drawing += open_svg(first.width_px * static_cast<double>(column),
                        top + first.height_px * static_cast<double>(row), first) +
               render_svg(charts[i]) + "</svg>\n";
  }
  return drawing + "</svg>\n";
}

}  // namespace covey
