// SPDX-License-Identifier: Apache-2.0
#include "apps/inspect_report.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <regex>
#include <set>
#include <utility>
#include <vector>

#include "apps/chart_sheet.h"
#include "apps/folder_entries.h"
#include "apps/inspect_pictures.h"
#include "apps/json_file.h"
#include "apps/png_file.h"
#include "apps/report_charts.h"
#include "apps/report_style.h"
#include "apps/run_summary.h"
#include "apps/whole_file.h"
#include "sim/thermal_camera.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr char kPage[] = "index.html", kSummary[] = "summary.json";
constexpr char kEndOfTitle[] = " \u00b7 Covey</title>";
constexpr double kChartWidth = 420, kChartHeight = 240;  // px
constexpr char kRawColor[] = "series-d", kCalibratedColor[] = "series-a", kTruthColor[] = "muted";

Json to_json(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

Json to_json(const std::optional<GainErrors>& errors) {
  return errors ? Json{{"mean", errors->mean}, {"worst", errors->worst}} : Json();
}

Json to_json(const InspectedFlight& flight, const Dataset& dataset) {
  Json json = {
      {"tracks", {{"mean_per_frame", flight.mean_tracks}, {"mean_length", flight.mean_length}}},
      {"repeated_images", flight.repeated_images},
      {"uniform_images", flight.uniform_images},
      {"filter_restarts", flight.filter_restarts},
      {"ate_se3_m", Json()}};
  if (dataset.ground_truth && !flight.path.empty()) {
    const AccuracySummary accuracy =
        summarize_accuracy(flight.path, to_trajectory(*dataset.ground_truth), {});
    json["ate_se3_m"] = accuracy.se3.rmse;
  }
  return json;
}

// Of the recording, when it has one that images of 8 bits need not ask for.
std::optional<double> kelvin_per_count(const InspectReport& report) {
  if (first_readable(report.inspection.dataset).depth() != CV_16U) return std::nullopt;
  return ThermalSensor().raw_k_per_count;
}

std::optional<ThermalComparison> comparison(const InspectReport& report) {
  if (!report.truth || !report.inspection.calibrated) return std::nullopt;
  return compare_with_truth(report.inspection.gains, report.inspection.fields, *report.truth,
                            kelvin_per_count(report));
}

Json to_json(const ThermalComparison& compared) {
  return {{"gain_error",
           {{"over_third_of_a_second", to_json(compared.third)},
            {"over_a_second", to_json(compared.second)},
            {"since_the_chain_began", to_json(compared.chain)},
            {"within_the_chain", to_json(compared.within_chain)}}},
          {"field_rms_ratio", to_json(compared.field_rms)},
          {"field_rms_ratio_without_slope", to_json(compared.field_rms_without_slope)},
          {"true_field_k", to_json(compared.true_field_k)}};
}

Chart empty_chart(const std::string& title, const std::string& x, const std::string& y) {
  Chart chart;
  chart.title = title;
  chart.x_label = x;
  chart.y_label = y;
  chart.width_px = kChartWidth;
  chart.height_px = kChartHeight;
  return chart;
}

Curve curve_of(const std::string& label, const std::string& color) {
  Curve curve;
  curve.label = label;
  curve.color = color;
  return curve;
}

Curve corner_curve(const CornerHistogram& corners, const std::string& label,
                   const std::string& color) {
  constexpr double kPercent = 100;
  Curve curve = curve_of(label, color);
  for (int bin = 0; bin < CornerHistogram::kBins; ++bin) {
    curve.points.emplace_back(CornerHistogram::middle(bin),
                              kPercent * corners.shares[static_cast<std::size_t>(bin)]);
  }
  return curve;
}

Chart corner_chart(const Inspection& inspection) {
  Chart chart = empty_chart("corner response", "log10 of Harris' response", "% of the pixels");
  chart.y_from_zero = true;
  chart.curves.push_back(corner_curve(inspection.raw.corners, "raw", kRawColor));
  if (inspection.calibrated) {
    chart.curves.push_back(
        corner_curve(inspection.calibrated->corners, "calibrated", kCalibratedColor));
  }
  return chart;
}

Chart track_chart(const Inspection& inspection) {
  Chart chart = empty_chart("tracks", "time, s", "tracks in the image");
  chart.y_from_zero = true;
  const auto add = [&chart](const InspectedFlight& flight, const char* label, const char* color) {
    Curve curve = curve_of(label, color);
    curve.points = flight.tracks;
    chart.curves.push_back(std::move(curve));
  };
  add(inspection.raw, "raw", kRawColor);
  if (inspection.calibrated) add(*inspection.calibrated, "calibrated", kCalibratedColor);
  return chart;
}

std::vector<Chart> gain_charts(const Inspection& inspection,
                               const std::optional<ThermalComparison>& compared) {
  const TimeNs start_ns = inspection.dataset.images.front().stamp_ns;
  Curve truth = curve_of("truth", kTruthColor), found = curve_of("estimate", kCalibratedColor);
  truth.dashed = true;
  const auto draw = [&](double GainOffset::*value, Chart chart) {
    if (compared) add_chains(compared->true_gains, start_ns, truth, value, chart);
    chart.curves.push_back(found);
    add_chains(inspection.gains, start_ns, found, value, chart);
    return chart;
  };
  std::vector<Chart> charts;
  charts.push_back(
      draw(&GainOffset::gain, empty_chart("gain", "time, s", "of the chain's first image")));
  charts.push_back(
      draw(&GainOffset::offset, empty_chart("offset", "time, s", "grey levels of that image")));
  if (compared && !compared->field_rms_over.empty()) {
    Chart chart = empty_chart("error of the field", "time, s", "RMS, of the true field's");
    chart.y_from_zero = true;
    Curve curve = found;
    curve.points = compared->field_rms_over;
    chart.curves.push_back(std::move(curve));
    charts.push_back(std::move(chart));
  }
  return charts;
}

void write_pictures(const fs::path& folder, const Inspection& inspection) {
  for (std::size_t i = 0; i < inspection.raw.pictures.size(); ++i) {
    const std::string name = "_" + std::to_string(i + 1) + ".png";
    const Picture& raw = inspection.raw.pictures[i];
    if (!inspection.calibrated) {
      write_png((folder / ("tracks" + name)).string(), draw_tracks(raw, inspection.dataset.mask));
      continue;
    }
    const Picture& calibrated = inspection.calibrated->pictures[i];
    write_png((folder / ("before_after" + name)).string(), side_by_side(raw.grey, calibrated.grey));
    write_png((folder / ("tracks" + name)).string(),
              side_by_side(draw_tracks(calibrated, inspection.dataset.mask),
                           draw_tracks(raw, inspection.dataset.mask)));
  }
}

struct TrueField {
  cv::Mat levels;  // CV_32FC1, grey levels of the estimate's chain
};

// The newest one before the end of the flight.
std::optional<TrueField> true_field(const InspectReport& report, const FieldRecord& estimate) {
  if (!report.truth) return std::nullopt;
  const auto record_at = [&](TimeNs stamp_ns) {
    return std::find_if(report.truth->begin(), report.truth->end(),
                        [&](const ThermalTruthRecord& r) { return r.stamp_ns == stamp_ns; });
  };
  const auto now = record_at(estimate.stamp_ns), first = record_at(estimate.chain_ns);
  if (now == report.truth->end() || first == report.truth->end() || now->field.empty()) {
    return std::nullopt;
  }
  constexpr double kLevels = 255;
  const double level_k =
      kelvin_per_count(report).value_or((first->white_k - first->black_k) / kLevels);
  cv::Mat levels = read_true_field(now->field);
  levels = (levels - cv::mean(levels)[0]) / level_k;
  return TrueField{levels};
}

double largest(const cv::Mat& field) { return cv::norm(field, cv::NORM_INF); }

void write_field(const fs::path& folder, const InspectReport& report) {
  if (report.inspection.fields.empty()) return;
  const FieldRecord& last = report.inspection.fields.back();
  const auto truth = true_field(report, last);
  constexpr double kLeastRange = 1e-3;  // grey levels
  double range = std::max(kLeastRange, largest(last.field));
  if (truth) range = std::max(range, largest(truth->levels));
  cv::Mat picture = draw_field(last.field, range, last.field.size());
  if (truth) {
    picture = side_by_side(picture, draw_field(truth->levels, range, last.field.size()));
  }
  write_png((folder / "field.png").string(), picture);
}

std::string heading(const std::string& title, const std::string& explanation) {
  return "<h2>" + title + "</h2>\n<p>" + explanation + "</p>\n";
}

std::string image(const std::string& file) {
  return "<figure><img src=\"" + file + "\" alt=\"\" style=\"width:100%\"></figure>\n";
}

std::string images(const std::string& stem, std::size_t count) {
  std::string html;
  for (std::size_t i = 1; i <= count; ++i) html += image(stem + "_" + std::to_string(i) + ".png");
  return html;
}

std::string row(const std::string& name, const std::optional<double>& value, int decimals) {
  if (!value) return "";
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, *value);
  return "<tr><td>" + name + "</td><td>" + text + "</td></tr>\n";
}

std::string flight_rows(const std::string& name, const InspectedFlight& flight) {
  return row(name + ": tracks in an image", flight.mean_tracks, 1) +
         row(name + ": images a track lives", flight.mean_length, 1);
}

std::string figures_table(const Inspection& inspection,
                          const std::optional<ThermalComparison>& compared) {
  std::string rows = flight_rows("raw", inspection.raw);
  if (inspection.calibrated) rows += flight_rows("calibrated", *inspection.calibrated);
  rows += row("raw: change of a track's patch in ten images, median, of the image's deviation",
              inspection.raw_residual, 4);
  rows += row("calibrated: the same", inspection.calibrated_residual, 4);
  if (inspection.pixel_lag_s) {
    rows += row("lag of the pixels, estimated, ms", 1e3 * *inspection.pixel_lag_s, 2);
  }
  constexpr double kPercent = 100;
  if (inspection.pattern_share) {
    rows += row("images whose gain the sensor's own pattern tells, %",
                kPercent * *inspection.pattern_share, 0);
  }
  const auto percent = [](const std::optional<GainErrors>& errors) -> std::optional<double> {
    if (!errors) return std::nullopt;
    return kPercent * errors->mean;
  };
  if (compared) {
    rows += row("mean error of the gain over a third of a second, %", percent(compared->third), 2);
    rows += row("over a second, %", percent(compared->second), 2);
    rows += row("since its chain began, %", percent(compared->chain), 2);
    rows += row("RMS error of the field, of the true field's RMS", compared->field_rms, 3);
  }
  return "<div class=\"table\"><table>\n" + rows + "</table></div>\n";
}

std::string page(const InspectReport& report, const std::optional<ThermalComparison>& compared) {
  const Inspection& inspection = report.inspection;
  const std::size_t pictures = inspection.raw.pictures.size();
  const bool thermal = inspection.calibrated.has_value();
  std::string html =
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n<title>" +
      escape_html(report.dataset + ", " + report.drone) + kEndOfTitle + "\n<style>" + kReportStyle +
      "</style>\n</head>\n<body>\n<main>\n<h1>" +
      escape_html(report.dataset + ", " + report.drone) + "</h1>\n";
  html += figures_table(inspection, compared);
  html +=
      heading("Tracks", std::string("Blue: SLAM features; orange: their past tells where they "
                                    "are (MSCKF); purple: opportunistic.") +
                            (thermal ? " Calibrated left, raw right." : "")) +
      images("tracks", pictures) + image("tracks.svg") +
      heading("Corner response", "Share of the pixels by the logarithm of their Harris response.") +
      image("harris.svg");
  if (thermal) {
    html += heading("Before and after", "Raw left, calibrated right.") +
            images("before_after", pictures) +
            heading("Gain and offset",
                    "From each image's grey levels to those of the first since the camera last "
                    "looked at its shutter.") +
            image("gain_offset.svg");
    if (!inspection.fields.empty()) {
      html += heading("Additive field",
                      "At the end of the flight, its mean taken off; the truth beside it where it "
                      "is known.") +
              image("field.png");
    }
  }
  return html + "</main>\n</body>\n</html>\n";
}

bool is_file_of_report(const fs::path& file) {
  static const std::regex kPicture("(before_after|tracks)_[0-9]+\\.png");
  static const std::set<std::string> kOthers = {kPage,        kSummary,          "harris.svg",
                                                "tracks.svg", "gain_offset.svg", "field.png"};
  const std::string name = file.filename();
  return is_plain_file(file) && (kOthers.count(name) > 0 || std::regex_match(name, kPicture));
}

bool is_our_page(const fs::path& page) {
  std::ifstream stream(page, std::ios::binary);
  const std::string html{std::istreambuf_iterator<char>(stream), {}};
  return html.find(kEndOfTitle) != std::string::npos;
}

}  // namespace

nlohmann::json inspect_summary(const InspectReport& report) {
  const Inspection& inspection = report.inspection;
  Json json = {{"schema", 1},
               {"dataset", report.dataset},
               {"drone", report.drone},
               {"images", inspection.dataset.images.size()},
               {"left_out", inspection.left_out},
               {"thermal", inspection.dataset.thermal},
               {"raw", to_json(inspection.raw, inspection.dataset)},
               {"calibrated", Json()},
               {"patch_residual", Json()},
               {"pixel_lag_s", to_json(inspection.pixel_lag_s)},
               {"pattern_share", to_json(inspection.pattern_share)},
               {"truth", Json()}};
  if (inspection.calibrated) {
    json["calibrated"] = to_json(*inspection.calibrated, inspection.dataset);
    json["patch_residual"] = {{"raw", to_json(inspection.raw_residual)},
                              {"calibrated", to_json(inspection.calibrated_residual)}};
  }
  if (const auto compared = comparison(report)) json["truth"] = to_json(*compared);
  return json;
}

void write_inspect_report(const fs::path& folder, const InspectReport& report) {
  const Inspection& inspection = report.inspection;
  const auto compared = comparison(report);
  std::vector<SheetEntry> legend = {{"raw", kRawColor}};
  if (inspection.calibrated) legend.push_back({"calibrated", kCalibratedColor});
  write_pictures(folder, inspection);
  write_whole_file(folder / "harris.svg", chart_sheet({corner_chart(inspection)}, legend));
  write_whole_file(folder / "tracks.svg", chart_sheet({track_chart(inspection)}, legend));
  if (inspection.calibrated) {
    std::vector<SheetEntry> gains = {{"estimate", kCalibratedColor}};
    if (compared) gains.push_back({"truth", kTruthColor});
    write_whole_file(folder / "gain_offset.svg",
                     chart_sheet(gain_charts(inspection, compared), gains));
    write_field(folder, report);
  }
  write_json_file(folder / kSummary, inspect_summary(report));
  write_whole_file(folder / kPage, page(report, compared));
}

bool is_inspect_report(const fs::path& folder) {
  return fs::exists(folder / kPage) && fs::exists(folder / kSummary) &&
         all_entries(folder, is_file_of_report) && is_our_page(folder / kPage);
}

}  // namespace covey
