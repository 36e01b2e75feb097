// SPDX-License-Identifier: Apache-2.0
#include "apps/study_report.h"

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

Json to_json(const TeamFigures& figures) {
  return {{"aligned_m", figures.aligned_m},         {"unaligned_m", figures.unaligned_m},
          {"position_nees", figures.position_nees}, {"orientation_nees", figures.orientation_nees},
          {"worse_aligned", figures.worse_aligned}, {"worse_unaligned", figures.worse_unaligned}};
}

Json to_json(const StudyConfig& config) {
  return {{"scenario", config.scenario},       {"seeds", config.seeds},
          {"duration_s", config.duration_s},   {"recorded_trajectories", config.recorded.size()},
          {"pixel_sigma", config.pixel_sigma}, {"corner_mismatch_px", config.corner_mismatch_px}};
}

Json to_json(const ScalingPoint& point) {
  return {{"drones", point.drones},
          {"alone", to_json(point.alone)},
          {"together", to_json(point.together)},
          {"overlapping_peers", point.overlapping_peers},
          {"question_bytes_per_s", point.question_bytes_per_s},
          {"answer_bytes_per_s", point.answer_bytes_per_s},
          {"sent_bytes_per_s", point.sent_bytes_per_s},
          {"fusion_ms_per_s", point.fusion_ms_per_s}};
}

std::string scaling_csv(const std::vector<ScalingPoint>& points) {
  std::string csv =
      "drones,aligned_alone_m,aligned_together_m,unaligned_alone_m,unaligned_together_m,"
      "position_nees,orientation_nees,overlapping_peers,question_bytes_per_s,answer_bytes_per_s,"
      "sent_bytes_per_s,fusion_ms_per_s\n";
  for (const ScalingPoint& p : points) {
    char line[256];
    std::snprintf(line, sizeof line, "%d,%.5f,%.5f,%.5f,%.5f,%.3f,%.3f,%.2f,%.0f,%.0f,%.0f,%.3f\n",
                  p.drones, p.alone.aligned_m, p.together.aligned_m, p.alone.unaligned_m,
                  p.together.unaligned_m, p.together.position_nees, p.together.orientation_nees,
                  p.overlapping_peers, p.question_bytes_per_s, p.answer_bytes_per_s,
                  p.sent_bytes_per_s, p.fusion_ms_per_s);
    csv += line;
  }
  return csv;
}

std::string ablation_csv(const std::vector<AblationRow>& rows) {
  std::string csv =
      "variant,aligned_m,unaligned_m,position_nees,orientation_nees,worse_aligned,worse_unaligned,"
      "relative_poses\n";
  for (const AblationRow& row : rows) {
    const TeamFigures& f = row.figures;
    char numbers[128];
    std::snprintf(numbers, sizeof numbers, ",%.5f,%.5f,%.3f,%.3f,%.3f,%.3f,%.1f\n", f.aligned_m,
                  f.unaligned_m, f.position_nees, f.orientation_nees, f.worse_aligned,
                  f.worse_unaligned, row.relative_poses);
    csv += "\"" + row.variant + "\"" + numbers;
  }
  return csv;
}

template <typename Value>
Curve curve_of(const std::vector<ScalingPoint>& points, const std::string& label,
               const std::string& color, const Value& value) {
  Curve curve;
  curve.label = label;
  curve.color = color;
  curve.width_px = 2.4;
  for (const ScalingPoint& point : points) curve.points.emplace_back(point.drones, value(point));
  return curve;
}

Chart chart_of(const std::string& title, const std::string& unit) {
  Chart chart;
  chart.title = title;
  chart.x_label = "drones";
  chart.y_label = unit;
  chart.width_px = 300;
  chart.height_px = 230;
  chart.y_from_zero = true;
  return chart;
}

std::vector<Chart> charts_of(const std::vector<ScalingPoint>& points) {
  Chart error = chart_of("error: alone (grey), together", "RMSE, aligned [cm]");
  error.curves = {curve_of(points, "alone", "muted",
                           [](const ScalingPoint& p) { return 100 * p.alone.aligned_m; }),
                  curve_of(points, "together", "series-a",
                           [](const ScalingPoint& p) { return 100 * p.together.aligned_m; })};
  Chart bytes = chart_of("sent per drone", "[kB/s]");
  bytes.curves = {curve_of(points, "answers, and each question to every peer", "series-d",
                           [](const ScalingPoint& p) { return p.sent_bytes_per_s / 1000; })};
  Chart cpu = chart_of("fusion per drone", "CPU [ms per second of flight]");
  cpu.curves = {curve_of(points, "relative poses and drift filter", "series-c",
                         [](const ScalingPoint& p) { return p.fusion_ms_per_s; })};
  Chart peers = chart_of("peers that overlap", "per drone");
  peers.curves = {curve_of(points, "of whom a relative pose was used", "series-e",
                           [](const ScalingPoint& p) { return p.overlapping_peers; })};
  return {error, peers, bytes, cpu};
}

}  // namespace

void write_scaling(const std::filesystem::path& folder, const StudyConfig& config,
                   const std::vector<ScalingPoint>& points) {
  Json json = to_json(config);
  for (const ScalingPoint& point : points) json["points"].push_back(to_json(point));
  write_json_file(folder / "summary.json", json);
  write_whole_file(folder / "scaling.csv", scaling_csv(points));
  const std::vector<Chart> charts = charts_of(points);
  write_whole_file(folder / "scaling.svg", chart_sheet(charts, {}, charts.size()));
}

void write_ablation(const std::filesystem::path& folder, const StudyConfig& config,
                    const std::vector<AblationRow>& rows) {
  Json json = to_json(config);
  for (const AblationRow& row : rows) {
    Json variant = to_json(row.figures);
    variant["variant"] = row.variant;
    variant["relative_poses"] = row.relative_poses;
    json["variants"].push_back(variant);
  }
  write_json_file(folder / "summary.json", json);
  write_whole_file(folder / "ablation.csv", ablation_csv(rows));
}

bool is_scaling(const std::filesystem::path& folder) {
  return holds_exactly(folder, {"scaling.csv", "scaling.svg", "summary.json"});
}

bool is_ablation(const std::filesystem::path& folder) {
  return holds_exactly(folder, {"ablation.csv", "summary.json"});
}

std::string scaling_table(const std::vector<ScalingPoint>& points) {
  char line[192];
  std::snprintf(line, sizeof line, "%6s %14s %16s %9s %9s %7s %10s %8s\n", "drones",
                "alone/together", "unaligned [m]", "NEES p", "NEES q", "peers", "sent [B/s]",
                "CPU ms/s");
  std::string table = line;
  for (const ScalingPoint& p : points) {
    std::snprintf(line, sizeof line, "%6d %6.4f/%7.4f %7.4f/%8.4f %9.2f %9.2f %7.1f %10.0f %8.2f\n",
                  p.drones, p.alone.aligned_m, p.together.aligned_m, p.alone.unaligned_m,
                  p.together.unaligned_m, p.together.position_nees, p.together.orientation_nees,
                  p.overlapping_peers, p.sent_bytes_per_s, p.fusion_ms_per_s);
    table += line;
  }
  return table;
}

std::string ablation_table(const std::vector<AblationRow>& rows) {
  char line[192];
  std::snprintf(line, sizeof line, "%-50s %11s %6s %13s %6s %6s %6s %6s %9s\n", "variant",
                "aligned [m]", "ratio", "unaligned [m]", "ratio", "NEES p", "NEES q", "used",
                "worse [%]");
  std::string table = line;
  for (const AblationRow& row : rows) {
    const TeamFigures &f = row.figures, &alone = rows.front().figures;
    std::snprintf(line, sizeof line,
                  "%-50s %11.4f %6.3f %13.4f %6.3f %6.2f %6.2f %6.1f %4.0f %4.0f\n",
                  row.variant.c_str(), f.aligned_m, f.aligned_m / alone.aligned_m, f.unaligned_m,
                  f.unaligned_m / alone.unaligned_m, f.position_nees, f.orientation_nees,
                  row.relative_poses, 100 * f.worse_aligned, 100 * f.worse_unaligned);
    table += line;
  }
  return table;
}

}  // namespace covey
