// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_report.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <utility>

#include "apps/json_file.h"
#include "apps/report_style.h"
#include "apps/svg.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

using Figure = LabFigures::Figure;

// What is varied in an experiment, in the order in which it is looked for to be the x axis.
struct Dimension {
  const char* name;
  std::string (*label)(const LabCell&);
  double (*value)(const LabCell&);
};

const std::vector<Dimension>& dimensions() {
  static const std::vector<Dimension> all{
      {"frames lost [%]",
       [](const LabCell& c) { return fmt::format("{:g} %", 100 * c.quality.loss); },
       [](const LabCell& c) { return 100 * c.quality.loss; }},
      {"drones", [](const LabCell& c) { return fmt::format("{} drones", c.drones); },
       [](const LabCell& c) { return static_cast<double>(c.drones); }},
      {"rate [Mbit/s]",
       [](const LabCell& c) {
         return c.quality.rate_bit_per_s > 0
                    ? fmt::format("{:g} Mbit/s", 1e-6 * c.quality.rate_bit_per_s)
                    : std::string("any rate");
       },
       [](const LabCell& c) { return 1e-6 * c.quality.rate_bit_per_s; }},
      {"delay [ms]",
       [](const LabCell& c) { return fmt::format("{:g} ms", 1e3 * c.quality.delay_s); },
       [](const LabCell& c) { return 1e3 * c.quality.delay_s; }},
      {"frames lost in a row",
       [](const LabCell& c) { return fmt::format("bursts of {:g}", c.quality.mean_burst); },
       [](const LabCell& c) { return c.quality.mean_burst; }},
  };
  return all;
}

// Text for what cannot be an axis.
const std::vector<std::string (*)(const LabCell&)>& names() {
  static const std::vector<std::string (*)(const LabCell&)> all{
      [](const LabCell& c) { return c.profile; }, [](const LabCell& c) { return c.exchange; },
      [](const LabCell& c) { return c.variant.name; }};
  return all;
}

bool varies(const std::vector<LabOutcome>& outcomes,
            const std::function<std::string(const LabCell&)>& of) {
  return std::any_of(outcomes.begin(), outcomes.end(), [&](const LabOutcome& outcome) {
    return of(outcome.cell) != of(outcomes.front().cell);
  });
}

const Dimension& x_axis(const std::vector<LabOutcome>& outcomes) {
  for (const Dimension& dimension : dimensions()) {
    if (varies(outcomes, dimension.label)) return dimension;
  }
  return dimensions().front();
}

// All that varies but the x axis.
std::string series_of(const LabCell& cell, const std::vector<LabOutcome>& outcomes,
                      const Dimension& x) {
  std::string label;
  const auto add = [&](std::string (*of)(const LabCell&)) {
    if (varies(outcomes, of)) label += (label.empty() ? "" : ", ") + of(cell);
  };
  for (const auto& name : names()) add(name);
  for (const Dimension& dimension : dimensions()) {
    if (&dimension != &x) add(dimension.label);
  }
  return label.empty() ? "all flights" : label;
}

// Flights that differ in seed and repeat alone.
struct Setting {
  LabCell cell;
  std::vector<const LabFigures*> flights;

  [[nodiscard]] Figure mean(LabFigures::Figure LabFigures::*figure) const {
    double sum = 0;
    int count = 0;
    for (const LabFigures* flight : flights) {
      if (!(flight->*figure)) continue;
      sum += *(flight->*figure);
      ++count;
    }
    if (count == 0) return std::nullopt;
    return sum / count;
  }
};

std::vector<Setting> settings_of(const std::vector<LabOutcome>& outcomes) {
  std::vector<Setting> settings;
  std::map<std::string, std::size_t> known;
  for (const LabOutcome& outcome : outcomes) {
    LabCell cell = outcome.cell;
    cell.seed = 0;
    cell.repeat = 0;
    const auto [entry, is_new] = known.emplace(cell.name(), settings.size());
    if (is_new) settings.push_back({cell, {}});
    settings[entry->second].flights.push_back(&outcome.figures);
  }
  return settings;
}

// ---------------------------------------------------------------------------------------- tables

std::string cells_csv(const std::vector<LabOutcome>& outcomes) {
  std::string csv =
      "drones,profile,exchange,variant,loss,mean_burst,rate_mbit,delay_ms,jitter_ms,queue_ms,seed,"
      "repeat";
  for (const LabFigureColumn& column : lab_figure_columns()) csv += std::string(",") + column.name;
  csv += "\n";
  for (const LabOutcome& outcome : outcomes) {
    const LabCell& cell = outcome.cell;
    const LinkQuality& link = cell.quality;
    csv += fmt::format("{},{},{},{},{:g},{:g},{:g},{:g},{:g},{:g},{},{}", cell.drones, cell.profile,
                       cell.exchange, cell.variant.name, link.loss, link.mean_burst,
                       1e-6 * link.rate_bit_per_s, 1e3 * link.delay_s, 1e3 * link.jitter_s,
                       1e3 * link.queue_s, cell.seed, cell.repeat);
    for (const LabFigureColumn& column : lab_figure_columns()) {
      const Figure& figure = outcome.figures.*column.figure;
      csv += figure ? fmt::format(",{:.6g}", *figure) : std::string(",");
    }
    csv += "\n";
  }
  return csv;
}

nlohmann::json cell_json(const LabOutcome& outcome) {
  return {{"name", outcome.cell.name()},
          {"drones", outcome.cell.drones},
          {"profile", outcome.cell.profile},
          {"exchange", outcome.cell.exchange},
          {"variant", outcome.cell.variant.name},
          {"loss", outcome.cell.quality.loss},
          {"mean_burst", outcome.cell.quality.mean_burst},
          {"rate_mbit", 1e-6 * outcome.cell.quality.rate_bit_per_s},
          {"delay_ms", 1e3 * outcome.cell.quality.delay_s},
          {"seed", outcome.cell.seed},
          {"repeat", outcome.cell.repeat},
          {"figures", to_json(outcome.figures)}};
}

struct TableColumn {
  const char* head;
  const char* format;
  LabFigures::Figure LabFigures::*figure;
  double scale;
};

// Columns without any figure are left out.
const std::vector<TableColumn>& table_columns() {
  static const std::vector<TableColumn> columns{
      {"met s", "{:.2f}", &LabFigures::met_after_s, 1},
      {"heard %", "{:.1f}", &LabFigures::heard_share, 100},
      {"answers", "{:.0f}", &LabFigures::answers, 1},
      {"arrived %", "{:.1f}", &LabFigures::arrived_share, 100},
      {"in 500 ms %", "{:.1f}", &LabFigures::arrived_500ms_share, 100},
      {"fused", "{:.0f}", &LabFigures::fused, 1},
      {"round trip ms", "{:.0f}", &LabFigures::round_trip_ms, 1},
      {"p95 ms", "{:.0f}", &LabFigures::round_trip_p95_ms, 1},
      {"wire kB/s", "{:.2f}", &LabFigures::wire_bytes_per_s, 1e-3},
      {"wire/payload", "{:.2f}", &LabFigures::wire_over_payload, 1},
      {"ATE ratio", "{:.2f}", &LabFigures::ate_ratio, 1},
      {"unaligned", "{:.2f}", &LabFigures::unaligned_ratio, 1},
      {"images dropped", "{:.0f}", &LabFigures::frames_dropped, 1},
      {"apart m", "{:.3f}", &LabFigures::apart_m, 1},
      {"alone m", "{:.3f}", &LabFigures::apart_alone_m, 1},
      {"rejoined m", "{:.3f}", &LabFigures::rejoined_m, 1},
      {"alone m", "{:.3f}", &LabFigures::rejoined_alone_m, 1},
      {"fused again s", "{:.1f}", &LabFigures::fused_again_s, 1},
      {"kills", "{:.0f}", &LabFigures::kills, 1},
      {"met again", "{:.0f}", &LabFigures::met_again, 1},
      {"after s", "{:.2f}", &LabFigures::met_again_median_s, 1},
      {"at most s", "{:.2f}", &LabFigures::met_again_max_s, 1},
      {"silence s", "{:.2f}", &LabFigures::longest_silence_s, 1},
  };
  return columns;
}

std::vector<TableColumn> used_columns(const std::vector<Setting>& settings) {
  std::vector<TableColumn> used;
  for (const TableColumn& column : table_columns()) {
    const bool any = std::any_of(settings.begin(), settings.end(), [&](const Setting& setting) {
      return setting.mean(column.figure).has_value();
    });
    if (any) used.push_back(column);
  }
  return used;
}

std::string field(const Setting& setting, const TableColumn& column) {
  const Figure mean = setting.mean(column.figure);
  return mean ? fmt::format(fmt::runtime(column.format), *mean * column.scale) : "-";
}

std::string setting_label(const LabCell& cell, const std::vector<LabOutcome>& outcomes,
                          const Dimension& x) {
  const std::string series = series_of(cell, outcomes, x);
  return (series == "all flights" ? "" : series + ", ") + x.label(cell);
}

std::string html_table(const std::vector<LabOutcome>& outcomes, const Dimension& x) {
  const std::vector<Setting> settings = settings_of(outcomes);
  const std::vector<TableColumn> columns = used_columns(settings);
  std::string html = "<div class=\"table\"><table><tr><th>setting</th><th>flights</th>";
  for (const TableColumn& column : columns) html += fmt::format("<th>{}</th>", column.head);
  html += "</tr>\n";
  for (const Setting& setting : settings) {
    html +=
        fmt::format("<tr><td>{}</td><td>{}</td>",
                    escape_html(setting_label(setting.cell, outcomes, x)), setting.flights.size());
    for (const TableColumn& column : columns) {
      html += "<td>" + field(setting, column) + "</td>";
    }
    html += "</tr>\n";
  }
  return html + "</table></div>\n";
}

// ---------------------------------------------------------------------------------------- charts

constexpr const char* kColors[] = {"drone0", "drone1", "drone2", "drone3", "drone4", "drone5"};

struct Series {
  std::string label, color;
  bool dashed = false;
  std::vector<Setting> settings;  // by x
};

std::vector<Series> series_in(const std::vector<LabOutcome>& outcomes, const Dimension& x) {
  std::vector<Series> all;
  for (Setting& setting : settings_of(outcomes)) {
    const std::string label = series_of(setting.cell, outcomes, x);
    auto known = std::find_if(all.begin(), all.end(),
                              [&](const Series& series) { return series.label == label; });
    if (known == all.end()) {
      const std::size_t index = all.size();
      all.push_back({label, kColors[index % std::size(kColors)], index >= std::size(kColors), {}});
      known = all.end() - 1;
    }
    known->settings.push_back(std::move(setting));
  }
  for (Series& series : all) {
    std::sort(
        series.settings.begin(), series.settings.end(),
        [&x](const Setting& a, const Setting& b) { return x.value(a.cell) < x.value(b.cell); });
  }
  return all;
}

struct Axis {
  const char* label;
  LabFigures::Figure LabFigures::*figure;
  double scale;
};

void add_curve(const Series& series, const std::function<Figure(const Setting&)>& x_of,
               const Axis& y, Chart& chart) {
  Curve curve;
  curve.label = series.label;
  curve.color = series.color;
  curve.dashed = series.dashed;
  curve.width_px = 2.2;
  for (const Setting& setting : series.settings) {
    const Figure x = x_of(setting), mean = setting.mean(y.figure);
    if (!x || !mean) continue;
    curve.points.emplace_back(*x, *mean * y.scale);
    Marker marker;
    marker.label = fmt::format("{}: {:.4g}", series.label, *mean * y.scale);
    marker.color = series.color;
    marker.at = curve.points.back();
    chart.markers.push_back(marker);
  }
  if (!curve.points.empty()) chart.curves.push_back(curve);
}

std::string figure_html(const std::string& title, const std::string& x_label, const Axis& y,
                        const std::vector<Series>& all,
                        const std::function<Figure(const Setting&)>& x_of) {
  Chart chart;
  chart.title = title;
  chart.x_label = x_label;
  chart.y_label = y.label;
  chart.y_from_zero = true;
  chart.height_px = 230;
  for (const Series& series : all) add_curve(series, x_of, y, chart);
  if (chart.curves.empty()) return "";
  return "<figure>" + render_svg(chart) + "</figure>\n";
}

std::string charts(const std::vector<LabOutcome>& outcomes, const Dimension& x) {
  const std::vector<Series> all = series_in(outcomes, x);
  std::string html = "<div class=\"legend\">";
  for (const Series& series : all) {
    html += fmt::format("<span><i{} style=\"border-color:var(--{})\"></i>{}</span>",
                        series.dashed ? " class=\"dashed\"" : "", series.color,
                        escape_html(series.label));
  }
  html += "</div>\n<div class=\"charts three\">\n";
  const auto at_x = [&x](const Setting& setting) { return Figure(x.value(setting.cell)); };
  const auto at_bytes = [](const Setting& setting) -> Figure {
    const Figure mean = setting.mean(&LabFigures::wire_bytes_per_s);
    if (!mean) return std::nullopt;
    return *mean * 1e-3;
  };
  const Axis ate{"together / alone", &LabFigures::ate_ratio, 1};
  html += figure_html(
      "answers in time", x.name,
      {"handled within 500 ms of the question [%]", &LabFigures::arrived_500ms_share, 100}, all,
      at_x);
  html += figure_html("answers that arrive", x.name, {"[%]", &LabFigures::arrived_share, 100}, all,
                      at_x);
  html += figure_html("question to answer, median", x.name, {"[ms]", &LabFigures::round_trip_ms, 1},
                      all, at_x);
  html += figure_html("question to answer, p95", x.name,
                      {"[ms]", &LabFigures::round_trip_p95_ms, 1}, all, at_x);
  html += figure_html("messages fused", x.name, {"all drones", &LabFigures::fused, 1}, all, at_x);
  html += figure_html("on the wire", x.name,
                      {"[kB/s] per drone", &LabFigures::wire_bytes_per_s, 1e-3}, all, at_x);
  html += figure_html("error (ATE, aligned)", x.name, ate, all, at_x);
  html += figure_html("error, not aligned", x.name,
                      {"together / alone", &LabFigures::unaligned_ratio, 1}, all, at_x);
  html += figure_html("error against bytes", "on the wire [kB/s] per drone", ate, all, at_bytes);
  html +=
      figure_html("until all have met", x.name, {"[s]", &LabFigures::met_after_s, 1}, all, at_x);
  return html + "</div>\n";
}

std::string page(const LabExperiment& experiment, const std::vector<LabOutcome>& outcomes) {
  const Dimension& x = x_axis(outcomes);
  return "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
         "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n<title>" +
         escape_html(experiment.name) + " \u00b7 Covey lab</title>\n<style>" + kReportStyle +
         "</style>\n</head>\n<body>\n<main>\n<h1>" + escape_html(experiment.name) + "</h1>\n<p>" +
         escape_html(experiment.about) + "</p>\n" + charts(outcomes, x) +
         "<h2>All settings</h2>\n<p>Means over seeds and repeats; docs/lab.md says what the "
         "columns "
         "mean.</p>\n" +
         html_table(outcomes, x) +
         "<footer>Drawn by covey lab from summary.json beside this page.</footer>\n"
         "</main>\n</body>\n</html>\n";
}

}  // namespace

void write_lab_results(const std::filesystem::path& out, const LabExperiment& experiment,
                       const std::vector<LabOutcome>& outcomes) {
  nlohmann::json json{{"schema", 1}, {"name", experiment.name}, {"about", experiment.about}};
  json["cells"] = nlohmann::json::array();
  for (const LabOutcome& outcome : outcomes) json["cells"].push_back(cell_json(outcome));
  write_json_file(out / "summary.json", json);
  write_whole_file(out / "cells.csv", cells_csv(outcomes));
  if (!outcomes.empty()) write_whole_file(out / "report.html", page(experiment, outcomes));
}

std::string lab_table(const std::vector<LabOutcome>& outcomes) {
  if (outcomes.empty()) return "";
  const Dimension& x = x_axis(outcomes);
  const std::vector<Setting> settings = settings_of(outcomes);
  const std::vector<TableColumn> columns = used_columns(settings);
  std::size_t width = 0;
  for (const Setting& setting : settings) {
    width = std::max(width, setting_label(setting.cell, outcomes, x).size());
  }
  std::string table = fmt::format("{:<{}}", "", width);
  for (const TableColumn& column : columns) table += fmt::format("  {}", column.head);
  table += "\n";
  for (const Setting& setting : settings) {
    table += fmt::format("{:<{}}", setting_label(setting.cell, outcomes, x), width);
    for (const TableColumn& column : columns) {
      table += fmt::format("  {:>{}}", field(setting, column), std::string(column.head).size());
    }
    table += "\n";
  }
  return table;
}

}  // namespace covey
