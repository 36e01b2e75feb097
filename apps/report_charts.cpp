// SPDX-License-Identifier: Apache-2.0
#include "apps/report_charts.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <functional>
#include <opencv2/core.hpp>

#include "estimator/initializer.h"

namespace covey {
namespace {

constexpr double kDegrees = 180.0 / 3.14159265358979323846;
constexpr std::size_t kDroneColors = 6;
constexpr int kBins = 120;             // of the stacked stage times, over the whole run
constexpr double kRateBinS = 1.0;      // s over which bytes per second are taken
constexpr double kMostRateBins = 1e4;  // of hours; one stamp that is years off makes them wider
constexpr double kBandRoom = 3;        // a band may stretch an axis to this many times the error
constexpr char kStageTitle[] = "time per image";
constexpr char kFeatureTitle[] = "features";
constexpr char kUpdateTitle[] = "features in updates";
constexpr char kMessageTitle[] = "messages so far";
constexpr char kOutcomeTitle[] = "what became of those received";
constexpr char kCornerTitle[] = "corner response";
constexpr char kAxisName[] = {'x', 'y', 'z'};

double seconds(const AgentRun& agent, TimeNs stamp_ns) {
  return seconds_between(agent.start_ns, stamp_ns);
}

// `columns`: how many stand side by side; letters come out equally large.
Chart time_chart(const AgentRun& agent, int columns, const std::string& title,
                 const std::string& unit) {
  Chart chart;
  chart.width_px = columns == 4 ? 285 : 380;
  chart.height_px = columns == 4 ? 180 : 200;
  chart.title = title;
  chart.x_label = agent.time_of_its_own ? "time since its own start, s" : "time, s";
  chart.y_label = unit;
  chart.x_range = AxisRange{0, std::max(1e-3, seconds(agent, agent.end_ns))};
  return chart;
}

Curve path_of(const StampedPoses& trajectory, int axis_x, int axis_y) {
  Curve curve;
  for (const StampedPose& pose : trajectory) {
    curve.points.emplace_back(pose.pose.p_world_imu[axis_x], pose.pose.p_world_imu[axis_y]);
  }
  return curve;
}

Chart projection(const RunData& data, const std::string& title, int axis_x, int axis_y) {
  Chart chart;
  chart.title = title;
  chart.x_label = std::string(1, kAxisName[axis_x]) + ", m";
  chart.y_label = std::string(1, kAxisName[axis_y]) + ", m";
  chart.width_px = 560;
  chart.height_px = 170;
  chart.max_height_px = 520;
  chart.equal_scale = true;
  for (const AgentRun& agent : data.agents) {
    Curve truth = path_of(agent.truth, axis_x, axis_y);
    truth.label = agent.name + ", truth";
    truth.color = "truth";
    truth.width_px = 3.5;
    chart.curves.push_back(std::move(truth));
  }
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    const AgentRun& agent = data.agents[i];
    Curve alone = path_of(agent.alone, axis_x, axis_y);
    alone.label = agent.name + ", alone";
    alone.color = drone_color(i);
    alone.width_px = 1.2;
    alone.dashed = true;
    chart.curves.push_back(std::move(alone));
    Curve estimate = path_of(agent.estimate, axis_x, axis_y);
    estimate.label = agent.name + ", estimate";
    estimate.color = drone_color(i);
    estimate.width_px = 1.8;
    if (!estimate.points.empty()) {
      chart.markers.push_back({agent.name + " starts", drone_color(i), estimate.points.front()});
    }
    chart.curves.push_back(std::move(estimate));
  }
  return chart;
}

Curve distance_curve(const AgentRun& agent, const std::vector<PosePair>& pairs) {
  Curve curve;
  const Similarity similarity = align(pairs, Alignment::kPosYaw);
  for (const PosePair& pair : pairs) {
    const Pose aligned = transform(similarity, pair.estimate);
    curve.points.emplace_back(seconds(agent, pair.stamp_ns),
                              (pair.truth.p_world_imu - aligned.p_world_imu).norm());
  }
  return curve;
}

// Of the rotation about the vertical: the local error's covariance, seen in the world.
double yaw_sigma(const Pose& pose, const Matrix6d& covariance) {
  const Eigen::Vector3d up_imu = pose.q_world_imu.conjugate() * Eigen::Vector3d::UnitZ();
  const Eigen::Matrix3d local = covariance.bottomRightCorner<3, 3>();
  return std::sqrt(std::max(0.0, up_imu.dot(local * up_imu)));
}

// An error and the filter's sigma of it, as numbers over time.
struct ErrorChannel {
  std::string title;
  std::string unit;
  std::function<double(const PosePair&)> error;
  std::function<double(const PosePair&, const Matrix6d&)> sigma;
};

std::vector<ErrorChannel> channels() {
  std::vector<ErrorChannel> list;
  list.reserve(4);
  for (int axis = 0; axis < 3; ++axis) {
    list.push_back({std::string("error in ") + kAxisName[axis], "m",
                    [axis](const PosePair& pair) {
                      return pair.estimate.p_world_imu[axis] - pair.truth.p_world_imu[axis];
                    },
                    [axis](const PosePair&, const Matrix6d& covariance) {
                      return std::sqrt(std::max(0.0, covariance(axis, axis)));
                    }});
  }
  list.push_back({"error in yaw", "degrees",
                  [](const PosePair& pair) {
                    return kDegrees *
                           yaw_between(pair.truth.q_world_imu, pair.estimate.q_world_imu);
                  },
                  [](const PosePair& pair, const Matrix6d& covariance) {
                    return kDegrees * yaw_sigma(pair.estimate, covariance);
                  }});
  return list;
}

// Symmetric, and wide enough for the error; a start that is very unsure does not flatten the rest.
AxisRange error_range(const Curve& error, const Band& three_sigma) {
  double largest = 0;
  double widest = 0;
  for (const Eigen::Vector2d& p : error.points) largest = std::max(largest, std::abs(p.y()));
  for (const Eigen::Vector3d& e : three_sigma.edges) widest = std::max(widest, e.z());
  const double reach = std::max({largest, std::min(widest, kBandRoom * largest), 1e-6}) * 1.08;
  return {-reach, reach};
}

Chart channel_chart(const AgentRun& agent, const ErrorChannel& channel) {
  Chart chart = time_chart(agent, 4, channel.title, channel.unit);
  Curve error;
  error.label = agent.name + ", " + channel.title;
  error.color = "ink";
  error.width_px = 1.4;
  Band band;
  band.label = "3 sigma";
  band.color = "sigma";
  band.opacity = 0.35;
  auto sample = agent.covariances.begin();
  for (const PosePair& pair : agent.pairs) {
    const double t = seconds(agent, pair.stamp_ns);
    error.points.emplace_back(t, channel.error(pair));
    while (sample != agent.covariances.end() && sample->stamp_ns < pair.stamp_ns) ++sample;
    if (sample == agent.covariances.end() || sample->stamp_ns != pair.stamp_ns) continue;
    const double reach = 3 * channel.sigma(pair, sample->covariance);
    band.edges.emplace_back(t, -reach, reach);
  }
  chart.y_range = error_range(error, band);
  chart.bands.push_back(std::move(band));
  chart.curves.push_back(std::move(error));
  return chart;
}

// Image work in blues, places in purples, the filter in oranges, peers in green.
struct StageStyle {
  const char* label;
  const char* color;
  double TimingRecord::*ms;
};
constexpr std::array<StageStyle, 10> kStages = {{
    {"read", "stage-read", &TimingRecord::read_ms},
    {"thermal", "stage-thermal", &TimingRecord::thermal_ms},
    {"track", "stage-track", &TimingRecord::track_ms},
    {"describe", "stage-describe", &TimingRecord::describe_ms},
    {"place", "stage-place", &TimingRecord::place_ms},
    {"match", "stage-match", &TimingRecord::match_ms},
    {"propagate", "stage-propagate", &TimingRecord::propagate_ms},
    {"msckf", "stage-msckf", &TimingRecord::msckf_ms},
    {"slam", "stage-slam", &TimingRecord::slam_ms},
    {"peer", "stage-peer", &TimingRecord::peer_ms},
}};

bool stage_ran(const AgentRun& agent, const StageStyle& stage) {
  return std::any_of(agent.timings.begin(), agent.timings.end(),
                     [&](const TimingRecord& record) { return record.*stage.ms > 0; });
}

// Means over equal stretches of time, stacked.
Chart stage_chart(const AgentRun& agent) {
  Chart chart = time_chart(agent, 3, kStageTitle, "ms");
  chart.y_from_zero = true;
  const double bin_s = chart.x_range->high / kBins;
  std::vector<std::array<double, kStages.size()>> sums(kBins);
  std::vector<int> counts(kBins, 0);
  for (const TimingRecord& record : agent.timings) {
    const int bin =
        std::clamp(static_cast<int>(seconds(agent, record.stamp_ns) / bin_s), 0, kBins - 1);
    ++counts[static_cast<std::size_t>(bin)];
    for (std::size_t s = 0; s < kStages.size(); ++s) {
      sums[static_cast<std::size_t>(bin)][s] += record.*kStages[s].ms;
    }
  }
  std::vector<double> base(kBins, 0);
  for (std::size_t s = 0; s < kStages.size(); ++s) {
    if (!stage_ran(agent, kStages[s])) continue;
    Band band;
    band.label = kStages[s].label;
    band.color = kStages[s].color;
    band.opacity = 0.9;
    for (std::size_t bin = 0; bin < static_cast<std::size_t>(kBins); ++bin) {
      if (counts[bin] == 0) continue;
      const double top = base[bin] + sums[bin][s] / counts[bin];
      band.edges.emplace_back((static_cast<double>(bin) + 0.5) * bin_s, base[bin], top);
      base[bin] = top;
    }
    chart.bands.push_back(std::move(band));
  }
  return chart;
}

// `count`: of a record, a member or a function of it.
template <typename Record, typename Count>
Curve curve_of(const AgentRun& agent, const std::vector<Record>& records, const Count& count,
               const std::string& label, const std::string& color) {
  Curve curve;
  curve.label = label;
  curve.color = color;
  for (const Record& record : records) {
    curve.points.emplace_back(seconds(agent, record.stamp_ns),
                              static_cast<double>(std::invoke(count, record)));
  }
  return curve;
}

Chart feature_chart(const AgentRun& agent) {
  Chart chart = time_chart(agent, 3, kFeatureTitle, "number");
  chart.y_from_zero = true;
  chart.curves = {
      curve_of(agent, agent.timings, &TimingRecord::tracks, "tracks", "series-a"),
      curve_of(agent, agent.timings, &TimingRecord::slam_features, "SLAM features", "series-b"),
      curve_of(agent, agent.timings, &TimingRecord::clones, "poses in the window", "series-c")};
  return chart;
}

Chart update_chart(const AgentRun& agent) {
  Chart chart = time_chart(agent, 3, kUpdateTitle, "number");
  chart.y_from_zero = true;
  const auto used = [](const TimingRecord& record) { return record.msckf_used + record.slam_used; };
  const auto gated = [](const TimingRecord& record) {
    return record.msckf_gated + record.slam_gated;
  };
  chart.curves = {curve_of(agent, agent.timings, used, "used", "series-a"),
                  curve_of(agent, agent.timings, gated, "gated", "series-d")};
  return chart;
}

Chart message_chart(const AgentRun& agent) {
  Chart chart = time_chart(agent, 3, kMessageTitle, "number");
  chart.y_from_zero = true;
  chart.curves = {
      curve_of(agent, agent.link, &LinkRecord::requests_received, "requests received", "series-b"),
      curve_of(agent, agent.link, &LinkRecord::requests_sent, "requests sent", "series-a"),
      curve_of(agent, agent.link, &LinkRecord::messages_received, "messages received", "series-b"),
      curve_of(agent, agent.link, &LinkRecord::messages_sent, "messages sent", "series-a")};
  chart.curves[0].dashed = chart.curves[1].dashed = true;
  return chart;
}

Chart outcome_chart(const AgentRun& agent) {
  Chart chart = time_chart(agent, 3, kOutcomeTitle, "number");
  chart.y_from_zero = true;
  chart.curves = {curve_of(agent, agent.link, &LinkRecord::fused, "fused", "series-c"),
                  curve_of(agent, agent.link, &LinkRecord::gated, "gated", "series-d"),
                  curve_of(agent, agent.link, &LinkRecord::rejected, "rejected", "series-e")};
  return chart;
}

// Differences of the running total over bins, drawn as steps; the last one takes what is left.
Chart rate_chart(const AgentRun& agent) {
  Chart chart = time_chart(agent, 3, "payload sent", "kB/s");
  chart.y_from_zero = true;
  Curve curve;
  curve.label = "payload sent";
  curve.color = "series-a";
  const double span_s = chart.x_range->high;
  const double bin_s = std::max(kRateBinS, span_s / kMostRateBins);
  const auto bins =
      static_cast<std::size_t>(std::clamp(std::floor(span_s / kRateBinS), 1.0, kMostRateBins));
  std::vector<double> bytes(bins, 0);
  std::int64_t before = 0;
  for (const LinkRecord& record : agent.link) {
    const double bin = std::max(0.0, seconds(agent, record.stamp_ns) / bin_s);
    bytes[std::min(static_cast<std::size_t>(bin), bins - 1)] +=
        static_cast<double>(record.payload_bytes_sent - before);
    before = record.payload_bytes_sent;
  }
  for (std::size_t bin = 0; bin < bins; ++bin) {
    const double start_s = static_cast<double>(bin) * bin_s;
    const double end_s = bin + 1 < bins ? start_s + bin_s : span_s;
    const double rate = bytes[bin] / (end_s - start_s) / 1e3;
    curve.points.emplace_back(start_s, rate);
    curve.points.emplace_back(end_s, rate);
  }
  chart.curves.push_back(std::move(curve));
  return chart;
}

double highest(const std::vector<Chart>& charts) {
  double value = 0;
  for (const Chart& chart : charts) {
    for (const Curve& curve : chart.curves) {
      for (const Eigen::Vector2d& p : curve.points) value = std::max(value, p.y());
    }
  }
  return value;
}

bool anyone_alone(const RunData& data) {
  return std::any_of(data.agents.begin(), data.agents.end(),
                     [](const AgentRun& agent) { return !agent.alone.empty(); });
}

Chart corner_chart(const AgentRun& agent) {
  constexpr double kPercent = 100;
  Chart chart = time_chart(agent, 4, kCornerTitle, "% of the pixels");
  chart.x_label = "log10 of Harris' response";
  chart.x_range.reset();
  chart.y_from_zero = true;
  const auto add = [&](double CornerRecord::*share, const char* label, const char* color) {
    Curve curve;
    curve.label = label;
    curve.color = color;
    for (const CornerRecord& corner : agent.corners)
      curve.points.emplace_back(corner.log10_response, kPercent * corner.*share);
    chart.curves.push_back(std::move(curve));
  };
  add(&CornerRecord::raw, "raw", "series-d");
  add(&CornerRecord::calibrated, "calibrated", "series-a");
  return chart;
}

}  // namespace

std::string drone_color(std::size_t index) {
  return "drone" + std::to_string(index % kDroneColors);
}

std::vector<Chart> trajectory_charts(const RunData& data) {
  return {projection(data, "from above", 0, 1), projection(data, "from the side, along y", 0, 2),
          projection(data, "from the side, along x", 1, 2)};
}

Legend trajectory_legend(const RunData& data) {
  using Shape = LegendEntry::Shape;
  Legend legend;
  bool any_truth = false;
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    legend.entries.push_back({data.agents[i].name, drone_color(i), Shape::kLine});
    any_truth = any_truth || !data.agents[i].truth.empty();
  }
  if (anyone_alone(data)) legend.entries.push_back({"flown alone", "muted", Shape::kDashed});
  if (any_truth) legend.entries.push_back({"truth", "truth", Shape::kArea});
  legend.entries.push_back({"start", "muted", Shape::kDot});
  return legend;
}

int distance_columns(const RunData& data) { return data.agents.size() % 3 == 0 ? 3 : 4; }

Legend distance_legend(const RunData& data) {
  if (!anyone_alone(data)) return {};
  using Shape = LegendEntry::Shape;
  return {"", {{"together", "muted", Shape::kLine}, {"flown alone", "muted", Shape::kDashed}}};
}

std::vector<Chart> distance_charts(const RunData& data) {
  std::vector<Chart> charts;
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    const AgentRun& agent = data.agents[i];
    if (agent.pairs.empty()) continue;
    Chart chart = time_chart(agent, distance_columns(data), agent.name, "m");
    Curve alone = distance_curve(agent, agent.alone_pairs);
    alone.label = agent.name + ", alone";
    alone.color = drone_color(i);
    alone.dashed = true;
    alone.width_px = 1.2;
    Curve estimate = distance_curve(agent, agent.pairs);
    estimate.label = agent.name;
    estimate.color = drone_color(i);
    chart.curves = {std::move(alone), std::move(estimate)};
    charts.push_back(std::move(chart));
  }
  const AxisRange shared{0, std::max(1e-6, highest(charts) * 1.05)};
  for (Chart& chart : charts) chart.y_range = shared;
  return charts;
}

std::vector<Chart> consistency_charts(const AgentRun& agent) {
  std::vector<Chart> charts;
  if (agent.pairs.empty()) return charts;
  for (const ErrorChannel& channel : channels()) {
    charts.push_back(channel_chart(agent, channel));
  }
  return charts;
}

Legend consistency_legend() {
  using Shape = LegendEntry::Shape;
  return {"", {{"estimate minus truth", "ink", Shape::kLine}, {"3 sigma", "sigma", Shape::kArea}}};
}

std::vector<Chart> work_charts(const AgentRun& agent) {
  if (agent.timings.empty()) return {};
  return {stage_chart(agent), feature_chart(agent), update_chart(agent)};
}

std::vector<Legend> work_legends(const RunData& data) {
  using Shape = LegendEntry::Shape;
  Legend stages;
  stages.title = kStageTitle;
  for (const StageStyle& stage : kStages) {
    const bool ran = std::any_of(data.agents.begin(), data.agents.end(),
                                 [&](const AgentRun& agent) { return stage_ran(agent, stage); });
    if (ran) stages.entries.push_back({stage.label, stage.color, Shape::kArea});
  }
  return {
      stages,
      {kFeatureTitle,
       {{"tracks", "series-a", Shape::kLine},
        {"SLAM features", "series-b", Shape::kLine},
        {"poses in the window", "series-c", Shape::kLine}}},
      {kUpdateTitle, {{"used", "series-a", Shape::kLine}, {"gated", "series-d", Shape::kLine}}}};
}

void add_chains(const std::vector<PhotometricRecord>& records, TimeNs start_ns, const Curve& like,
                double GainOffset::*value, Chart& chart) {
  TimeNs chain_ns = 0;
  for (const PhotometricRecord& record : records) {
    if (chart.curves.empty() || record.chain_ns != chain_ns) chart.curves.push_back(like);
    chain_ns = record.chain_ns;
    chart.curves.back().points.emplace_back(seconds_between(start_ns, record.stamp_ns),
                                            record.map.*value);
  }
}

std::vector<Chart> thermal_charts(const AgentRun& agent) {
  if (agent.thermal.empty()) return {};
  Curve curve;
  curve.color = "series-a";
  Chart gain = time_chart(agent, 4, "gain", "of the chain's first image");
  add_chains(agent.thermal, agent.start_ns, curve, &GainOffset::gain, gain);
  Chart offset = time_chart(agent, 4, "offset", "grey levels of that image");
  add_chains(agent.thermal, agent.start_ns, curve, &GainOffset::offset, offset);
  std::vector<Chart> charts = {std::move(gain), std::move(offset)};
  if (!agent.corners.empty()) charts.push_back(corner_chart(agent));
  return charts;
}

Legend corner_legend(const RunData& data) {
  const bool none = std::all_of(data.agents.begin(), data.agents.end(),
                                [](const AgentRun& agent) { return agent.corners.empty(); });
  if (none) return {};
  using Shape = LegendEntry::Shape;
  return {kCornerTitle,
          {{"raw", "series-d", Shape::kLine}, {"calibrated", "series-a", Shape::kLine}}};
}

HeatMap field_map(const AgentRun& agent) {
  constexpr double kLeast = 0.1;  // grey levels; less is drawn pale
  HeatMap map;
  map.title = "additive field at the end";
  map.width_px = 285;
  map.range = std::max(kLeast, cv::norm(agent.field, cv::NORM_INF));
  for (int y = 0; y < agent.field.rows; ++y) {
    const auto* row = agent.field.ptr<float>(y);
    map.rows.emplace_back(row, row + agent.field.cols);
  }
  char caption[96];
  std::snprintf(caption, sizeof caption, "%.2g grey levels either way have the full colour",
                map.range);
  map.caption = caption;
  return map;
}

std::vector<Chart> link_charts(const AgentRun& agent) {
  if (agent.link.empty()) return {};
  return {message_chart(agent), outcome_chart(agent), rate_chart(agent)};
}

std::vector<Legend> link_legends() {
  using Shape = LegendEntry::Shape;
  return {{kMessageTitle,
           {{"requests sent", "series-a", Shape::kDashed},
            {"requests received", "series-b", Shape::kDashed},
            {"messages sent", "series-a", Shape::kLine},
            {"messages received", "series-b", Shape::kLine}}},
          {kOutcomeTitle,
           {{"fused", "series-c", Shape::kLine},
            {"gated", "series-d", Shape::kLine},
            {"rejected", "series-e", Shape::kLine}}}};
}

}  // namespace covey
