// SPDX-License-Identifier: Apache-2.0
#include "apps/svg.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <utility>

#include "comms/xml_tag.h"

namespace covey {
namespace {

constexpr double kLeft = 54, kRight = 10, kTop = 24, kBottom = 34;  // px around the plot
constexpr double kTolerance = 0.25;                       // px that a simplified curve may be off
constexpr double kMargin = 0.05;                          // of the data's range, free at either end
constexpr double kTickSpacingX = 48, kTickSpacingY = 24;  // px, at least

std::string fixed(double value, int decimals) {
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, value);
  return text;
}

std::string pixels(double value) { return fixed(value, 1); }

// -0.05 as a typesetter writes it, with the decimals the step between ticks needs.
std::string tick_text(double value, double step) {
  const int decimals = std::max(0, static_cast<int>(std::ceil(-std::log10(step) - 1e-9)));
  const double rounded = std::abs(value) < step * 1e-6 ? 0 : value;
  return (rounded < 0 ? "\u2212" : "") + fixed(std::abs(rounded), decimals);
}

struct Extent {
  AxisRange x{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  AxisRange y = x;

  void add(double px, double py) {
    x = {std::min(x.low, px), std::max(x.high, px)};
    y = {std::min(y.low, py), std::max(y.high, py)};
  }
  [[nodiscard]] bool empty() const { return x.low > x.high; }
};

Extent data_extent(const Chart& chart) {
  Extent extent;
  for (const Curve& curve : chart.curves) {
    for (const Eigen::Vector2d& p : curve.points) extent.add(p.x(), p.y());
  }
  for (const Band& band : chart.bands) {
    for (const Eigen::Vector3d& e : band.edges) {
      extent.add(e.x(), e.y());
      extent.add(e.x(), e.z());
    }
  }
  for (const Marker& marker : chart.markers) extent.add(marker.at.x(), marker.at.y());
  return extent;
}

// Never of no length: a curve that is constant still needs an axis.
AxisRange with_margin(const AxisRange& range, double share) {
  const double length = range.high - range.low;
  const double least = std::max(1e-9, 1e-6 * std::max(std::abs(range.low), std::abs(range.high)));
  const double margin = length > least ? share * length : std::max(0.5 * std::abs(range.low), 0.5);
  return {range.low - margin, range.high + margin};
}

AxisRange grown_to(const AxisRange& range, double length) {
  const double centre = (range.low + range.high) / 2;
  return {centre - length / 2, centre + length / 2};
}

// Where the plot is on the drawing, and which numbers it shows.
struct Plot {
  double width = 0, height = 0;  // px
  AxisRange x, y;

  [[nodiscard]] double to_x(double value) const {
    return (value - x.low) / (x.high - x.low) * width;
  }
  [[nodiscard]] double to_y(double value) const {
    return (y.high - value) / (y.high - y.low) * height;
  }
  [[nodiscard]] Eigen::Vector2d operator()(const Eigen::Vector2d& p) const {
    return {to_x(p.x()), to_y(p.y())};
  }
};

void make_scale_equal(const Chart& chart, Plot& plot) {
  const double x_length = plot.x.high - plot.x.low;
  const double y_length = plot.y.high - plot.y.low;
  plot.height = std::clamp(plot.width * y_length / x_length, plot.height,
                           std::max(plot.height, chart.max_height_px - kTop - kBottom));
  const double unit_per_px = std::max(x_length / plot.width, y_length / plot.height);
  plot.x = grown_to(plot.x, unit_per_px * plot.width);
  plot.y = grown_to(plot.y, unit_per_px * plot.height);
}

Plot plot_of(const Chart& chart, const Extent& extent) {
  Plot plot;
  plot.width = chart.width_px - kLeft - kRight;
  plot.height = chart.height_px - kTop - kBottom;
  plot.x = with_margin(extent.x, chart.equal_scale ? kMargin : 0);
  plot.y = with_margin(extent.y, kMargin);
  if (chart.y_from_zero) plot.y.low = 0;
  if (chart.x_range) plot.x = *chart.x_range;
  if (chart.y_range) plot.y = *chart.y_range;
  if (plot.y.high <= plot.y.low) plot.y.high = plot.y.low + 1;
  if (chart.equal_scale) make_scale_equal(chart, plot);
  return plot;
}

std::string line(double x1, double y1, double x2, double y2) {
  return "<line x1=\"" + pixels(x1) + "\" y1=\"" + pixels(y1) + "\" x2=\"" + pixels(x2) +
         "\" y2=\"" + pixels(y2) + "\"/>";
}

std::string text(double x, double y, const std::string& css_class, const std::string& content) {
  return "<text class=\"" + css_class + "\" x=\"" + pixels(x) + "\" y=\"" + pixels(y) + "\">" +
         escape_html(content) + "</text>";
}

std::string rectangle(const Plot& plot, const std::string& css_class) {
  return "<rect class=\"" + css_class + "\" x=\"" + pixels(kLeft) + "\" y=\"" + pixels(kTop) +
         "\" width=\"" + pixels(plot.width) + "\" height=\"" + pixels(plot.height) + "\"/>";
}

std::string axes(const Chart& chart, const Plot& plot) {
  std::string grid;
  std::string labels;
  const double x_step = round_step(plot.x.high - plot.x.low, plot.width / kTickSpacingX);
  const double y_step = chart.equal_scale
                            ? x_step
                            : round_step(plot.y.high - plot.y.low, plot.height / kTickSpacingY);
  for (const double tick : multiples(x_step, plot.x)) {
    const double x = kLeft + plot.to_x(tick);
    grid += line(x, kTop, x, kTop + plot.height);
    labels += text(x, kTop + plot.height + 14, "tick middle", tick_text(tick, x_step));
  }
  for (const double tick : multiples(y_step, plot.y)) {
    const double y = kTop + plot.to_y(tick);
    grid += line(kLeft, y, kLeft + plot.width, y);
    labels += text(kLeft - 5, y + 3.5, "tick end", tick_text(tick, y_step));
  }
  labels += text(0, 13, "title", chart.title);
  labels += text(kLeft + plot.width / 2, kTop + plot.height + 29, "tick middle", chart.x_label);
  labels += "<g transform=\"translate(11 " + pixels(kTop + plot.height / 2) + ") rotate(-90)\">" +
            text(0, 0, "tick middle", chart.y_label) + "</g>";
  return rectangle(plot, "back") + "<g class=\"grid\">" + grid + "</g>" + labels;
}

std::string path_data(const std::vector<Eigen::Vector2d>& points_px) {
  std::string data;
  for (const Eigen::Vector2d& p : points_px) {
    data += (data.empty() ? "M" : "L") + pixels(p.x()) + " " + pixels(p.y());
  }
  return data;
}

std::vector<Eigen::Vector2d> on_plot(const Plot& plot, const std::vector<Eigen::Vector2d>& points) {
  std::vector<Eigen::Vector2d> points_px;
  points_px.reserve(points.size());
  for (const Eigen::Vector2d& p : points) points_px.push_back(plot(p));
  return simplified(points_px, kTolerance);
}

std::string hover(const std::string& label) {
  return label.empty() ? "" : "<title>" + escape_html(label) + "</title>";
}

std::string draw(const Plot& plot, const Curve& curve) {
  if (curve.points.empty()) return "";
  return "<path class=\"curve" + std::string(curve.dashed ? " dashed" : "") +
         "\" style=\"stroke:var(--" + curve.color + ");stroke-width:" + pixels(curve.width_px) +
         "\" d=\"" + path_data(on_plot(plot, curve.points)) + "\">" + hover(curve.label) +
         "</path>";
}

std::string draw(const Plot& plot, const Band& band) {
  if (band.edges.empty()) return "";
  std::vector<Eigen::Vector2d> low;
  std::vector<Eigen::Vector2d> high;
  for (const Eigen::Vector3d& edge : band.edges) {
    low.emplace_back(edge.x(), edge.y());
    high.emplace_back(edge.x(), edge.z());
  }
  std::vector<Eigen::Vector2d> outline = on_plot(plot, low);
  const std::vector<Eigen::Vector2d> upper = on_plot(plot, high);
  outline.insert(outline.end(), upper.rbegin(), upper.rend());
  return "<path style=\"fill:var(--" + band.color + ");fill-opacity:" + fixed(band.opacity, 2) +
         "\" d=\"" + path_data(outline) + "Z\">" + hover(band.label) + "</path>";
}

std::string draw(const Plot& plot, const Marker& marker) {
  return "<circle class=\"marker\" style=\"fill:var(--" + marker.color + ")\" cx=\"" +
         pixels(plot.to_x(marker.at.x())) + "\" cy=\"" + pixels(plot.to_y(marker.at.y())) +
         "\" r=\"4\">" + hover(marker.label) + "</circle>";
}

}  // namespace

std::string render_svg(const Chart& chart) {
  const Extent extent = data_extent(chart);
  if (extent.empty()) return "";
  const Plot plot = plot_of(chart, extent);
  // The inner <svg> clips what reaches beyond the axes.
  std::string inner = "<svg x=\"" + pixels(kLeft) + "\" y=\"" + pixels(kTop) + "\" width=\"" +
                      pixels(plot.width) + "\" height=\"" + pixels(plot.height) + "\">";
  for (const Band& band : chart.bands) inner += draw(plot, band);
  for (const Curve& curve : chart.curves) inner += draw(plot, curve);
  for (const Marker& marker : chart.markers) inner += draw(plot, marker);
  inner += "</svg>";
  return "<svg class=\"chart\" role=\"img\" aria-label=\"" + escape_html(chart.title) +
         "\" viewBox=\"0 0 " + pixels(chart.width_px) + " " + pixels(kTop + plot.height + kBottom) +
         "\">" + axes(chart, plot) + inner + rectangle(plot, "frame") + "</svg>\n";
}

std::string render_svg(const HeatMap& map) {
  if (map.rows.empty() || map.rows.front().empty()) return "";
  constexpr double kTitleHeight = 24, kCaptionHeight = 20, kRim = 8;
  const double side = (map.width_px - 2 * kRim) / static_cast<double>(map.rows.front().size());
  const double height = side * static_cast<double>(map.rows.size());
  std::string cells;
  for (std::size_t y = 0; y < map.rows.size(); ++y) {
    for (std::size_t x = 0; x < map.rows[y].size(); ++x) {
      const double share = std::clamp(map.rows[y][x] / map.range, -1.0, 1.0);
      cells += "<rect x=\"" + pixels(kRim + side * static_cast<double>(x)) + "\" y=\"" +
               pixels(kTitleHeight + side * static_cast<double>(y)) + "\" width=\"" + pixels(side) +
               "\" height=\"" + pixels(side) + "\" fill=\"var(--" +
               (share > 0 ? "series-d" : "series-a") + ")\" fill-opacity=\"" +
               fixed(std::abs(share), 2) + "\"/>";
    }
  }
  const auto text = [&](double y, const char* kind, const std::string& words) {
    return "<text class=\"" + std::string(kind) + "\" x=\"" + pixels(kRim) + "\" y=\"" + pixels(y) +
           "\">" + escape_html(words) + "</text>";
  };
  return "<svg class=\"chart\" role=\"img\" aria-label=\"" + escape_html(map.title) +
         "\" viewBox=\"0 0 " + pixels(map.width_px) + " " +
         pixels(kTitleHeight + height + kCaptionHeight) + "\">" +
         text(kTitleHeight - kRim, "title", map.title) + cells +
         text(kTitleHeight + height + kCaptionHeight - kRim / 2, "", map.caption) + "</svg>\n";
}

std::string escape_html(const std::string& text) { return escaped(text); }

double round_step(double length, double count) {
  const double rough = length / std::max(1.0, count);
  const double power = std::pow(10, std::floor(std::log10(rough)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= rough * 0.999) return factor * power;
  }
  return 10 * power;
}

std::vector<double> multiples(double step, const AxisRange& range) {
  std::vector<double> values;
  const double slack = 1e-9 * step;
  for (double i = std::ceil((range.low - slack) / step); i * step <= range.high + slack; ++i) {
    values.push_back(i * step);
  }
  return values;
}

std::vector<Eigen::Vector2d> simplified(const std::vector<Eigen::Vector2d>& points,
                                        double tolerance) {
  if (points.size() < 3) return points;
  std::vector<bool> keep(points.size(), false);
  keep.front() = keep.back() = true;
  std::vector<std::pair<std::size_t, std::size_t>> pieces{{0, points.size() - 1}};
  while (!pieces.empty()) {
    const auto [first, last] = pieces.back();
    pieces.pop_back();
    const Eigen::Vector2d along = points[last] - points[first];
    const double length_squared = along.squaredNorm();
    double farthest = tolerance;
    std::size_t split = first;
    for (std::size_t i = first + 1; i < last; ++i) {
      const Eigen::Vector2d offset = points[i] - points[first];
      const double t =
          length_squared > 0 ? std::clamp(offset.dot(along) / length_squared, 0.0, 1.0) : 0;
      const double distance = (offset - t * along).norm();
      if (distance > farthest) {
        farthest = distance;
        split = i;
      }
    }
    if (split == first) continue;
    keep[split] = true;
    pieces.emplace_back(first, split);
    pieces.emplace_back(split, last);
  }
  std::vector<Eigen::Vector2d> result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (keep[i]) result.push_back(points[i]);
  }
  return result;
}

}  // namespace covey
