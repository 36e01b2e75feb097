// SPDX-License-Identifier: Apache-2.0
#include "apps/report.h"

#include <openssl/evp.h>

#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "apps/report_charts.h"
#include "apps/report_data.h"
#include "apps/report_style.h"
#include "apps/report_tables.h"
#include "apps/svg.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

std::string chip(const std::string& text) { return "<li>" + escape_html(text) + "</li>"; }

std::string decimal(double value, const char* format) {
  char text[64];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string title_block(const RunData& data) {
  const RunSummary& run = data.summary;
  const std::size_t drones = data.agents.size();
  std::string html = "<h1>" + escape_html(run.dataset) + "</h1>\n<ul class=\"chips\">";
  html += chip(run.mode == "solo" ? "each drone alone" : run.mode);
  if (run.exchange) html += chip(*run.exchange + " exchange");
  html += chip(run.init == "groundtruth" ? "started from ground truth" : run.init + " start");
  html += chip(std::to_string(drones) + (drones == 1 ? " drone" : " drones"));
  if (data.end_ns > data.start_ns && !data.apart) {
    html += chip(decimal(seconds_between(data.start_ns, data.end_ns), "%.1f s"));
  }
  if (run.real_time_factor) html += chip(decimal(*run.real_time_factor, "%.2f\u00d7 real time"));
  return html + "</ul>\n";
}

std::string notes_block(const std::vector<std::string>& notes) {
  if (notes.empty()) return "";
  std::string html = "<ul class=\"notes\">";
  for (const std::string& note : notes) html += "<li>" + escape_html(note) + "</li>";
  return html + "</ul>\n";
}

std::string swatch(const LegendEntry& entry) {
  const std::string color = "var(--" + entry.color + ")";
  switch (entry.shape) {
    case LegendEntry::Shape::kLine:
      return "<i style=\"border-color:" + color + "\"></i>";
    case LegendEntry::Shape::kDashed:
      return "<i class=\"dashed\" style=\"border-color:" + color + "\"></i>";
    case LegendEntry::Shape::kArea:
      return "<i class=\"area\" style=\"background:" + color + "\"></i>";
    case LegendEntry::Shape::kDot:
      return "<i class=\"dotted\" style=\"background:" + color + "\"></i>";
  }
  return "";
}

std::string legend_block(const Legend& legend) {
  if (legend.entries.empty()) return "";
  std::string html = "<div class=\"legend\">";
  if (!legend.title.empty()) html += "<b>" + escape_html(legend.title) + "</b>";
  for (const LegendEntry& entry : legend.entries) {
    html += "<span>" + swatch(entry) + escape_html(entry.label) + "</span>";
  }
  return html + "</div>\n";
}

std::string legend_blocks(const std::vector<Legend>& legends) {
  std::string html;
  for (const Legend& legend : legends) html += legend_block(legend);
  return html;
}

std::string figure(const Chart& chart) {
  const std::string svg = render_svg(chart);
  return svg.empty() ? "" : "<figure>" + svg + "</figure>\n";
}

std::string figures(const std::vector<Chart>& charts) {
  std::string html;
  for (const Chart& chart : charts) html += figure(chart);
  return html;
}

std::string section(const std::string& heading, const std::string& explanation,
                    const std::string& content) {
  if (content.empty()) return "";
  return "<section>\n<h2>" + heading + "</h2>\n<p>" + explanation + "</p>\n" + content +
         "</section>\n";
}

// A row of charts under each drone's name, with the legends above the first.
std::string rows_of_charts(const RunData& data, const std::string& columns,
                           const std::vector<Legend>& legends,
                           const std::function<std::vector<Chart>(const AgentRun&)>& charts) {
  std::string rows;
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    const std::string drawn = figures(charts(data.agents[i]));
    if (drawn.empty()) continue;
    rows += "<h3>" + drone_label(data, i) + "</h3>\n";
    rows += "<div class=\"charts " + columns + "\">\n";
    rows += drawn + "</div>\n";
  }
  return rows.empty() ? "" : legend_blocks(legends) + rows;
}

std::string trajectories(const RunData& data) {
  const std::string views = figures(trajectory_charts(data));
  if (views.empty()) return "";
  return legend_block(trajectory_legend(data)) + "<div class=\"charts paths\">\n" + views +
         "</div>\n";
}

std::string distances(const RunData& data) {
  const std::vector<Chart> charts = distance_charts(data);
  if (charts.empty()) return "";
  return legend_block(distance_legend(data)) + "<div class=\"charts " +
         std::string(distance_columns(data) == 3 ? "three" : "four") + "\">\n" + figures(charts) +
         "</div>\n";
}

std::string embedded_png(const std::string& file, const std::string& what) {
  std::string base64(4 * ((file.size() + 2) / 3) + 1, '\0');  // and the zero that ends it
  const int length = EVP_EncodeBlock(reinterpret_cast<unsigned char*>(base64.data()),
                                     reinterpret_cast<const unsigned char*>(file.data()),
                                     static_cast<int>(file.size()));
  base64.resize(static_cast<std::size_t>(length));
  return "<figure class=\"wide\"><img alt=\"" + escape_html(what) +
         "\" src=\"data:image/png;base64," + base64 + "\"></figure>\n";
}

// Of drones with thermal cameras.
std::string calibrations(const RunData& data) {
  std::string rows;
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    const AgentRun& agent = data.agents[i];
    if (agent.thermal.empty()) continue;
    rows += "<h3>" + drone_label(data, i) + "</h3>\n<div class=\"charts four\">\n" +
            figures(thermal_charts(agent));
    if (!agent.field.empty()) rows += "<figure>" + render_svg(field_map(agent)) + "</figure>\n";
    rows += "</div>\n";
    if (!agent.pictures.empty())
      rows += embedded_png(agent.pictures, "raw and calibrated images and tracks of " + agent.name);
  }
  return rows.empty() ? "" : legend_block(corner_legend(data)) + rows;
}

std::string sections(const RunData& data) {
  const bool own_worlds =
      std::any_of(data.agents.begin(), data.agents.end(),
                  [](const AgentRun& agent) { return agent.summary.alignments.has_value(); });
  return section(
             "Errors",
             "Absolute trajectory error, rmse over all images, after fitting position and yaw of "
             "the whole trajectory to the truth; rotation not aligned. A NEES of 3 is that of an "
             "honest filter.",
             error_table(data)) +
         section("Where the others' worlds lie",
                 "Each drone started in a world of its own. Found, against the truth, and one "
                 "standard deviation as the drone itself says.",
                 world_table(data)) +
         section("Trajectories",
                 own_worlds ? "As estimated, each in the world of its own start, not aligned."
                            : "As estimated in the world the drones share, not aligned.",
                 trajectories(data)) +
         section("Distance to the truth",
                 "Over time, after fitting position and yaw; one scale for all drones.",
                 distances(data)) +
         section("What the filters believe",
                 std::string("Error ") + (own_worlds ? "in the own world" : "in the shared world") +
                     ", not aligned, and three standard deviations either side.",
                 rows_of_charts(data, "four", {consistency_legend()}, consistency_charts)) +
         section(
             "Work", "Time per image is CPU time, averaged over short stretches.",
             work_table(data) + rows_of_charts(data, "three", work_legends(data), work_charts)) +
         section("What each camera turned out to be",
                 "Found in flight minus what was believed at its start (sensor.yaml), \u00b1 one "
                 "standard deviation. Rotation about the camera's axes; lever arm along the IMU's. "
                 "Marked, and worth a new calibration: what is off by more than three of the "
                 "standard deviations that the settings give it.",
                 camera_table(data)) +
         section(
             "Thermal calibration",
             "Gain and offset take an image's grey levels to those of the first image of its "
             "chain, which begins anew after a shutter event. Of flights over recordings, three "
             "moments: the raw image, the calibrated one, and what was followed in it. Blue: "
             "SLAM features; orange: their past tells where they are (MSCKF); purple: "
             "opportunistic. Corner response: share of these images' pixels by the logarithm "
             "of their Harris response.",
             calibrations(data)) +
         section("Link",
                 "Payload: requests and messages as encoded. Wire: everything the network carried, "
                 "where it was counted. Clocks: a peer's wall clock minus the drone's own, sure to "
                 "half the round trip.",
                 link_table(data) + clock_table(data) +
                     rows_of_charts(data, "three", link_legends(), link_charts));
}

std::string page(const RunData& data) {
  return "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         escape_html(data.summary.dataset) + " \u00b7 Covey</title>\n<style>" + kReportStyle +
         "</style>\n</head>\n<body>\n<main>\n" + title_block(data) + tiles(data) +
         notes_block(data.notes) + sections(data) +
         "<footer>Drawn by covey report from the files beside this page.</footer>\n"
         "</main>\n</body>\n</html>\n";
}

}  // namespace

std::filesystem::path write_report(const std::filesystem::path& run) {
  const RunData data = read_run(run);
  std::filesystem::path file = run / "report.html";
  write_whole_file(file, page(data));
  return file;
}

}  // namespace covey
