// SPDX-License-Identifier: Apache-2.0
//
// Line charts as inline SVG. Colours are names of CSS variables of the page (without the two
// dashes), so that one drawing serves light and dark.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

namespace covey {

struct Curve {
  std::string label;  // shown when the pointer rests on it
  std::string color;
  double width_px = 1.6;
  bool dashed = false;
  std::vector<Eigen::Vector2d> points;
};

// A filled strip between two curves: (x, low, high).
struct Band {
  std::string label;
  std::string color;
  double opacity = 0.2;
  std::vector<Eigen::Vector3d> edges;
};

struct Marker {
  std::string label;
  std::string color;
  Eigen::Vector2d at = Eigen::Vector2d::Zero();
};

struct AxisRange {
  double low = 0;
  double high = 0;
};

// Later entries of each list are drawn over earlier ones; bands under curves under markers.
struct Chart {
  std::string title;
  std::string x_label;  // with its unit
  std::string y_label;
  double width_px = 340;
  double height_px = 190;
  double max_height_px = 0;  // for equal_scale: as high as the data need, up to this
  bool equal_scale = false;  // one metre is as long upwards as sideways
  bool y_from_zero = false;
  std::optional<AxisRange> x_range;  // otherwise what the data need
  std::optional<AxisRange> y_range;
  std::vector<Band> bands;
  std::vector<Curve> curves;
  std::vector<Marker> markers;
};

// <svg>...</svg>; empty when there is nothing to draw.
[[nodiscard]] std::string render_svg(const Chart& chart);

// A square for each value, the stronger coloured the further it is from zero: orange above, blue
// below it.
struct HeatMap {
  std::string title;
  std::string caption;                    // below it: what the colours mean
  std::vector<std::vector<double>> rows;  // from the top
  double range = 1;                       // that has the full colour
  double width_px = 380;
};
[[nodiscard]] std::string render_svg(const HeatMap& map);

// For text and attributes of HTML and SVG.
[[nodiscard]] std::string escape_html(const std::string& text);

// A round number (1, 2 or 5 times a power of ten) that fits into `length` `count` times at most.
[[nodiscard]] double round_step(double length, double count);

// The multiples of `step` inside the range.
[[nodiscard]] std::vector<double> multiples(double step, const AxisRange& range);

// Fewer points, none of which was further than `tolerance` from the line that is left (Douglas and
// Peucker, 1973).
[[nodiscard]] std::vector<Eigen::Vector2d> simplified(const std::vector<Eigen::Vector2d>& points,
                                                      double tolerance);

}  // namespace covey
