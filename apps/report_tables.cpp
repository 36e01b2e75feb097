// SPDX-License-Identifier: Apache-2.0
#include "apps/report_tables.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <optional>
#include <utility>
#include <vector>

#include "apps/report_charts.h"
#include "apps/svg.h"

namespace covey {
namespace {

using Value = std::optional<double>;
using FromAgent = std::function<Value(const AgentRun&)>;

constexpr char kNothing[] = "\u2013";
constexpr double kSamePercent = 0.5;  // a change smaller than this is none
// Times the sigma at the start: what is off by more the filter was not told to expect.
constexpr double kFarOffSigmas = 3;

std::string number(const Value& value, int decimals) {
  if (!value) return kNothing;
  char text[64];
  std::snprintf(text, sizeof text, "%.*f", decimals, std::abs(*value));
  return (*value < 0 ? "\u2212" : "") + std::string(text);
}

std::string cell(const std::string& content, const std::string& css_class = "") {
  return (css_class.empty() ? "<td>" : "<td class=\"" + css_class + "\">") + content + "</td>";
}

// A column of numbers, one for each drone.
struct Column {
  std::string title;  // HTML
  FromAgent value;
  int decimals = 2;
};

Value mean(const RunData& data, const FromAgent& value) {
  double sum = 0;
  int count = 0;
  for (const AgentRun& agent : data.agents) {
    const Value one = value(agent);
    if (!one) continue;
    sum += *one;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

Value ate_together(const AgentRun& agent) {
  if (!agent.accuracy) return std::nullopt;
  return agent.accuracy->posyaw.rmse;
}

Value ate_alone(const AgentRun& agent) {
  if (!agent.alone_accuracy) return std::nullopt;
  return agent.alone_accuracy->posyaw.rmse;
}

// Percent by which `together` is larger than `alone`; negative is better.
Value change_percent(const Value& alone, const Value& together) {
  if (!alone || !together || *alone <= 0) return std::nullopt;
  return 100 * (*together - *alone) / *alone;
}

std::string change_text(const Value& percent) {
  if (!percent) return kNothing;
  const std::string amount = number(std::abs(*percent), 0) + " %";
  if (*percent <= -kSamePercent) return "<span class=\"better\">\u25bc " + amount + "</span>";
  if (*percent >= kSamePercent) return "<span class=\"worse\">\u25b2 " + amount + "</span>";
  return "as alone";
}

bool compared(const RunData& data) { return mean(data, ate_alone).has_value(); }

std::string bar(double share, const std::string& color) {
  char width[32];
  std::snprintf(width, sizeof width, "%.1f%%", 100 * share);
  return "<i style=\"width:" + std::string(width) + ";background:var(--" + color + ")\"></i>";
}

// Alone above together, against the largest error of the run.
std::string bars(const RunData& data, std::size_t index) {
  double largest = 0;
  for (const AgentRun& agent : data.agents) {
    largest = std::max({largest, ate_alone(agent).value_or(0), ate_together(agent).value_or(0)});
  }
  if (largest <= 0) return "";
  const AgentRun& agent = data.agents[index];
  std::string html = "<span class=\"bars\">";
  if (const Value alone = ate_alone(agent)) html += bar(*alone / largest, "truth");
  if (const Value together = ate_together(agent)) {
    html += bar(*together / largest, drone_color(index));
  }
  return html + "</span>";
}

std::string head(const std::vector<std::string>& titles) {
  std::string html = "<div class=\"table\"><table><thead><tr>";
  for (const std::string& title : titles) html += "<th>" + title + "</th>";
  return html + "</tr></thead><tbody>";
}

// One line for each drone, then the means.
std::string table(const RunData& data, const std::vector<Column>& columns) {
  std::vector<std::string> titles{"drone"};
  for (const Column& column : columns) titles.push_back(column.title);
  std::string html = head(titles);
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    html += "<tr>" + cell(drone_label(data, i));
    for (const Column& column : columns) {
      html += cell(number(column.value(data.agents[i]), column.decimals));
    }
    html += "</tr>";
  }
  if (data.agents.size() > 1) {
    html += "<tr class=\"mean\">" + cell("mean");
    for (const Column& column : columns) {
      html += cell(number(mean(data, column.value), column.decimals));
    }
    html += "</tr>";
  }
  return html + "</tbody></table></div>\n";
}

template <typename Get>
FromAgent of_accuracy(Get get) {
  return [get](const AgentRun& agent) -> Value {
    if (!agent.accuracy) return std::nullopt;
    return get(*agent.accuracy);
  };
}

std::vector<Column> error_columns() {
  return {
      {"path<br>m", [](const AgentRun& agent) { return agent.summary.distance_m; }, 1},
      {"SE3<br>ATE m", of_accuracy([](const AccuracySummary& a) { return a.se3.rmse; }), 3},
      {"not aligned<br>ATE m", of_accuracy([](const AccuracySummary& a) { return a.none.rmse; }),
       3},
      {"rotation<br>rmse \u00b0",
       of_accuracy([](const AccuracySummary& a) { return a.rotation_none_deg; }), 2},
      {"NEES<br>position", of_accuracy([](const AccuracySummary& a) { return a.nees_position; }),
       1},
      {"NEES<br>orientation",
       of_accuracy([](const AccuracySummary& a) { return a.nees_orientation; }), 1},
      {"started<br>after s",
       [](const AgentRun& agent) { return agent.summary.initialised_after_s; }, 1},
  };
}

std::string error_row(const RunData& data, std::size_t index) {
  const AgentRun& agent = data.agents[index];
  std::string html = "<tr>" + cell(drone_label(data, index));
  if (compared(data)) {
    html += cell(number(ate_alone(agent), 3)) + cell(number(ate_together(agent), 3), "main") +
            cell(change_text(change_percent(ate_alone(agent), ate_together(agent))));
  } else {
    html += cell(number(ate_together(agent), 3), "main");
  }
  html += cell(bars(data, index));
  for (const Column& column : error_columns()) {
    html += cell(number(column.value(agent), column.decimals));
  }
  return html + "</tr>";
}

std::string error_means(const RunData& data) {
  std::string html = "<tr class=\"mean\">" + cell("mean");
  const Value together = mean(data, ate_together);
  if (compared(data)) {
    const Value alone = mean(data, ate_alone);
    html += cell(number(alone, 3)) + cell(number(together, 3)) +
            cell(change_text(change_percent(alone, together)));
  } else {
    html += cell(number(together, 3));
  }
  html += cell("");
  for (const Column& column : error_columns()) {
    html += cell(number(mean(data, column.value), column.decimals));
  }
  return html + "</tr>";
}

std::int64_t payload_bytes(const LinkSummary& link) {
  return link.request.payload_bytes_sent + link.message.payload_bytes_sent;
}

Value payload_rate_kb(const AgentRun& agent) {
  const Value seconds = flown_s(agent);
  if (!seconds || !agent.summary.link) return std::nullopt;
  return static_cast<double>(payload_bytes(*agent.summary.link)) / *seconds / 1e3;
}

std::string tile(const std::string& label, const Value& value, int decimals,
                 const std::string& unit) {
  if (!value) return "";
  return "<div class=\"tile\"><b>" + number(value, decimals) + " <small>" + unit +
         "</small></b><span>" + label + "</span></div>";
}

std::string change_tile(const RunData& data) {
  const Value change = change_percent(mean(data, ate_alone), mean(data, ate_together));
  if (!change) return "";
  return "<div class=\"tile\"><b>" + change_text(change) +
         "</b><span>against flying alone</span></div>";
}

template <typename Get>
FromAgent of_link(Get get) {
  return [get](const AgentRun& agent) -> Value {
    if (!agent.summary.link) return std::nullopt;
    return get(*agent.summary.link);
  };
}

Value kilobytes(const std::optional<std::int64_t>& bytes) {
  if (!bytes) return std::nullopt;
  return static_cast<double>(*bytes) / 1e3;
}

template <typename Get>
Column count_column(const std::string& title, Get get) {
  return {title,
          of_link([get](const LinkSummary& link) { return Value(static_cast<double>(get(link))); }),
          0};
}

// A column of what calibrating in flight has found, a line for each of its numbers.
struct CameraColumn {
  std::string title;  // HTML
  CalibrationChange CameraChanges::*change;
  double scale;  // to the unit of the title
  int decimals;
};

constexpr double kMilli = 1e3;

std::vector<CameraColumn> camera_columns() {
  return {{"time offset<br>ms", &CameraChanges::time_offset_s, kMilli, 3},
          {"rotation \u00b0<br>x, y, z", &CameraChanges::rotation_deg, 1, 3},
          {"lever arm mm<br>x, y, z", &CameraChanges::p_imu_cam_m, kMilli, 2},
          {"focal lengths px<br>x, y", &CameraChanges::focal_lengths_px, 1, 2},
          {"principal point px<br>x, y", &CameraChanges::principal_point_px, 1, 2},
          {"k1", &CameraChanges::k1, 1, 5},
          {"k2", &CameraChanges::k2, 1, 5}};
}

// Null if the drone did not calibrate it.
const CalibrationChange* calibrated(const AgentRun& agent, const CameraColumn& column) {
  if (!agent.camera) return nullptr;
  const CalibrationChange& change = (*agent.camera).*column.change;
  return change.sigma.maxCoeff() > 0 ? &change : nullptr;
}

bool is_far_off(const CalibrationChange& change, Eigen::Index i) {
  return std::abs(change.difference[i]) > kFarOffSigmas * change.sigma_at_start[i];
}

std::string change_line(const CameraColumn& column, const CalibrationChange& change,
                        Eigen::Index i) {
  const double difference = column.scale * change.difference[i];
  const std::string line = (difference < 0 ? "" : "+") + number(difference, column.decimals) +
                           " \u00b1 " + number(column.scale * change.sigma[i], column.decimals);
  return is_far_off(change, i) ? "<span class=\"worse\">" + line + "</span>" : line;
}

std::string camera_row(const RunData& data, std::size_t index,
                       const std::vector<CameraColumn>& columns) {
  bool any_far_off = false;
  std::string cells;
  for (const CameraColumn& column : columns) {
    const CalibrationChange* change = calibrated(data.agents[index], column);
    std::string lines = change == nullptr ? kNothing : "";
    for (Eigen::Index i = 0; change != nullptr && i < change->difference.size(); ++i) {
      lines += (i > 0 ? "<br>" : "") + change_line(column, *change, i);
      any_far_off = any_far_off || is_far_off(*change, i);
    }
    cells += cell(lines);
  }
  const char* mark = any_far_off ? "<span class=\"early\">worth a new calibration</span>" : "";
  return "<tr>" + cell(drone_label(data, index) + mark) + cells + "</tr>";
}

}  // namespace

std::string drone_label(const RunData& data, std::size_t index) {
  const AgentRun& agent = data.agents[index];
  std::string html = "<i class=\"dot\" style=\"background:var(--" + drone_color(index) +
                     ")\"></i>" + escape_html(agent.name);
  if (agent.summary.incomplete) {
    html += "<span class=\"early\">" + escape_html(*agent.summary.incomplete) + "</span>";
  }
  return html;
}

std::string tiles(const RunData& data) {
  std::string html =
      tile("mean ATE" + std::string(compared(data) ? ", together" : ""), mean(data, ate_together),
           3, "m") +
      tile("mean ATE, alone", mean(data, ate_alone), 3, "m") + change_tile(data) +
      tile("mean rotation error",
           mean(data, of_accuracy([](const AccuracySummary& a) { return a.rotation_none_deg; })), 2,
           "\u00b0") +
      tile("payload sent per drone", mean(data, payload_rate_kb), 1, "kB/s") +
      tile("CPU per image",
           mean(data, [](const AgentRun& agent) { return agent.summary.cpu_ms_per_frame; }), 1,
           "ms");
  return html.empty() ? "" : "<div class=\"tiles\">" + html + "</div>\n";
}

std::string error_table(const RunData& data) {
  if (!mean(data, ate_together)) return "";
  std::vector<std::string> titles{"drone"};
  if (compared(data)) {
    titles.insert(titles.end(), {"alone<br>ATE m", "together<br>ATE m", "change"});
  } else {
    titles.emplace_back("ATE m");
  }
  titles.emplace_back("");
  for (const Column& column : error_columns()) titles.push_back(column.title);
  std::string html = head(titles);
  for (std::size_t i = 0; i < data.agents.size(); ++i) html += error_row(data, i);
  if (data.agents.size() > 1) html += error_means(data);
  return html + "</tbody></table></div>\n";
}

std::string work_table(const RunData& data) {
  const auto of_summary = [](auto member) {
    return [member](const AgentRun& agent) -> Value { return agent.summary.*member; };
  };
  const auto of_count = [](auto member) {
    return [member](const AgentRun& agent) -> Value {
      return static_cast<double>(agent.summary.*member);
    };
  };
  const Column columns[] = {
      {"images", of_count(&AgentSummary::frames), 0},
      {"dropped", of_count(&AgentSummary::frames_dropped), 0},
      {"CPU ms<br>per image", of_summary(&AgentSummary::cpu_ms_per_frame), 1},
      {"CPU<br>max %", of_summary(&AgentSummary::max_cpu_percent), 0},
      {"memory<br>max MiB", of_summary(&AgentSummary::max_rss_mib), 0},
      {"tracks<br>per image", of_summary(&AgentSummary::mean_tracks_per_frame), 0},
      {"images<br>per track", of_summary(&AgentSummary::mean_track_length), 1},
  };
  return table(data, {std::begin(columns), std::end(columns)});
}

std::string link_table(const RunData& data) {
  const bool any = std::any_of(data.agents.begin(), data.agents.end(), [](const AgentRun& agent) {
    return agent.summary.link.has_value();
  });
  if (!any) return "";
  return table(
      data, {count_column("requests<br>sent", [](const LinkSummary& l) { return l.request.sent; }),
             count_column("requests<br>received",
                          [](const LinkSummary& l) { return l.request.received; }),
             count_column("messages<br>sent", [](const LinkSummary& l) { return l.message.sent; }),
             count_column("messages<br>received",
                          [](const LinkSummary& l) { return l.message.received; }),
             count_column("fused", [](const LinkSummary& l) { return l.message.fused; }),
             count_column("gated", [](const LinkSummary& l) { return l.message.gated; }),
             count_column("rejected", [](const LinkSummary& l) { return l.message.rejected; }),
             {"payload<br>sent kB",
              of_link([](const LinkSummary& l) { return kilobytes(payload_bytes(l)); }), 1},
             {"payload<br>kB/s", payload_rate_kb, 2},
             {"wire sent<br>kB",
              of_link([](const LinkSummary& l) { return kilobytes(l.wire_bytes_sent); }), 1},
             {"wire received<br>kB",
              of_link([](const LinkSummary& l) { return kilobytes(l.wire_bytes_received); }), 1},
             count_column("link<br>restarted", restart_count)});
}

std::string camera_table(const RunData& data) {
  std::vector<CameraColumn> columns = camera_columns();
  const auto nobodys = [&](const CameraColumn& column) {
    return std::none_of(data.agents.begin(), data.agents.end(), [&](const AgentRun& agent) {
      return calibrated(agent, column) != nullptr;
    });
  };
  columns.erase(std::remove_if(columns.begin(), columns.end(), nobodys), columns.end());
  if (columns.empty()) return "";
  std::vector<std::string> titles{"drone"};
  for (const CameraColumn& column : columns) titles.push_back(column.title);
  std::string html = head(titles);
  for (std::size_t i = 0; i < data.agents.size(); ++i) html += camera_row(data, i, columns);
  return html + "</tbody></table></div>\n";
}

std::string world_table(const RunData& data) {
  std::string lines;
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    const AgentSummary& agent = data.agents[i].summary;
    if (!agent.alignments) continue;
    if (agent.alignments->empty())
      lines += "<tr>" + cell(drone_label(data, i)) + cell("none found") + "</tr>";
    for (const auto& [peer, world] : *agent.alignments) {
      lines += "<tr>" + cell(drone_label(data, i)) + cell(escape_html(peer)) +
               cell(number(world.position_error_m, 3)) + cell(number(world.position_sigma_m, 3)) +
               cell(number(world.yaw_error_deg, 2)) + cell(number(world.yaw_sigma_deg, 2)) +
               "</tr>";
    }
  }
  if (lines.empty()) return "";
  return head({"drone", "peer's world", "off by<br>m", "says<br>m", "off by<br>\u00b0",
               "says<br>\u00b0"}) +
         lines + "</tbody></table></div>\n";
}

std::string clock_table(const RunData& data) {
  std::string lines;
  for (std::size_t i = 0; i < data.agents.size(); ++i) {
    const std::optional<LinkSummary>& link = data.agents[i].summary.link;
    if (!link) continue;
    for (const auto& [peer, clock] : link->clocks) {
      lines += "<tr>" + cell(drone_label(data, i)) + cell(escape_html(peer)) +
               cell(number(clock.clock_offset_ms, 2)) + cell(number(clock.round_trip_ms, 2)) +
               "</tr>";
    }
  }
  if (lines.empty()) return "";
  return head({"drone", "peer", "peer's clock<br>ahead ms", "round trip<br>ms"}) + lines +
         "</tbody></table></div>\n";
}

}  // namespace covey
