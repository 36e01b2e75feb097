// SPDX-License-Identifier: Apache-2.0
#include "apps/report_data.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <limits>
#include <optional>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "apps/agent.h"
#include "apps/png_file.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

// Reads one part of a run; what is absent or broken is left empty and noted.
class PartReader {
 public:
  PartReader(const fs::path& run, std::vector<std::string>& notes) : run_(run), notes_(notes) {}

  template <typename Read>
  auto operator()(const fs::path& file, Read read) const -> decltype(read(file)) {
    try {
      return read(file);
    } catch (const std::runtime_error& error) {
      note(error.what());
      return {};
    }
  }

  template <typename Read>
  auto if_there(const fs::path& file, Read read) const -> decltype(read(file)) {
    if (!fs::exists(file)) return {};
    return (*this)(file, read);
  }

  // Paths in the page are relative to the run: it may be opened elsewhere.
  void note(std::string text) const {
    const std::string prefix = (run_ / "").string();
    for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix)) {
      text.erase(at, prefix.size());
    }
    notes_.push_back(std::move(text));
  }

 private:
  const fs::path& run_;
  std::vector<std::string>& notes_;
};

// As they are, if a browser can show them.
std::string read_pictures(const fs::path& file) {
  (void)read_png(file.string());
  return read_whole_file(file);
}

// Truth and covariances are only looked at where the estimate is; both may be absent.
void evaluate(const std::string& name, const PartReader& read, AgentRun& agent) {
  if (agent.truth.empty()) return;
  const auto pairs_of = [&](const StampedPoses& trajectory) -> std::vector<PosePair> {
    if (trajectory.empty()) return {};
    try {
      return associate(trajectory, agent.truth, AssociationOptions());
    } catch (const std::runtime_error& error) {
      read.note(name + ": " + error.what());
      return {};
    }
  };
  agent.pairs = pairs_of(agent.estimate);
  agent.alone_pairs = pairs_of(agent.alone);
  constexpr double kNearlyAll = 0.95;
  const std::size_t compared = agent.pairs.size(), told = agent.estimate.size();
  if (compared > 0 && static_cast<double>(compared) < kNearlyAll * static_cast<double>(told)) {
    read.note(name + ": the ground truth covers " + std::to_string(compared) + " of " +
              std::to_string(told) + " poses, and errors are of those");
  }
  try {
    if (!agent.pairs.empty()) {
      agent.accuracy = summarize_accuracy(agent.estimate, agent.truth, agent.covariances);
    }
    if (!agent.alone_pairs.empty()) {
      agent.alone_accuracy = summarize_accuracy(agent.alone, agent.truth, {});
    }
  } catch (const std::runtime_error& error) {
    read.note(name + ": " + error.what());
  }
}

AgentRun read_agent(const fs::path& run, const std::string& name, const AgentSummary& summary,
                    const PartReader& read) {
  AgentRun agent;
  agent.name = name;
  agent.summary = summary;
  const fs::path folder = run / name;
  for (const auto& [file, lines] : summary.lost_lines) {
    read.note(fmt::format("{}: {} lines of {} are missing: there was no room for them", name, lines,
                          file));
  }
  agent.camera = read.if_there(folder / kAgentSummaryFile, read_camera_changes);
  if (summary.not_started) {
    read.note(name + " did not start: " + *summary.not_started);
  } else {
    agent.estimate = read(folder / kTrajectoryFile, read_trajectory);
  }
  agent.alone = read.if_there(run / kSoloFolder / name / kTrajectoryFile, read_trajectory);
  agent.truth = read.if_there(folder / kGroundTruthFile, read_trajectory);
  agent.covariances = read.if_there(folder / kCovarianceFile, read_covariances);
  agent.timings = read(folder / kTimingsFile, read_timings);
  agent.link = read.if_there(folder / kLinkFile, read_link);
  agent.thermal = read.if_there(folder / kThermalFile, read_thermal);
  agent.field = read.if_there(folder / kFieldFile, read_field);
  agent.pictures = read.if_there(folder / kPicturesFile, read_pictures);
  agent.corners = read.if_there(folder / kCornersFile, read_corners);
  if (agent.truth.empty()) read.note(name + ": no ground truth, so no errors are shown");
  evaluate(name, read, agent);
  return agent;
}

// Of its images; nothing if there are none.
std::optional<std::pair<TimeNs, TimeNs>> span_of(const AgentRun& agent) {
  TimeNs first_ns = std::numeric_limits<TimeNs>::max();
  TimeNs last_ns = 0;
  const auto add = [&](const auto& records) {
    if (records.empty()) return;
    first_ns = std::min(first_ns, records.front().stamp_ns);
    last_ns = std::max(last_ns, records.back().stamp_ns);
  };
  add(agent.timings);
  add(agent.estimate);
  if (first_ns > last_ns) return std::nullopt;
  return std::pair(first_ns, last_ns);
}

void set_span(RunData& data) {
  TimeNs first_ns = std::numeric_limits<TimeNs>::max();
  TimeNs last_ns = 0;
  double flown_s = 0;
  for (AgentRun& agent : data.agents) {
    const auto span = span_of(agent);
    if (!span) continue;
    std::tie(agent.first_ns, agent.last_ns) = *span;
    std::tie(agent.start_ns, agent.end_ns) = *span;
    first_ns = std::min(first_ns, agent.first_ns);
    last_ns = std::max(last_ns, agent.last_ns);
    flown_s += seconds_between(agent.first_ns, agent.last_ns);
  }
  if (first_ns > last_ns) return;
  data.start_ns = first_ns;
  data.end_ns = last_ns;
  data.apart = seconds_between(first_ns, last_ns) > 2 * flown_s;
}

// One for all drones, unless nobody flies in more than half of it.
void set_time_axes(RunData& data) {
  for (AgentRun& agent : data.agents) {
    agent.time_of_its_own = data.apart;
    if (!data.apart) std::tie(agent.start_ns, agent.end_ns) = std::tie(data.start_ns, data.end_ns);
  }
  if (!data.apart) return;
  data.notes.emplace_back(
      "the drones flew at times far apart, so each one's time begins with its own flight: are "
      "their recordings of one clock?");
}

// A recorded ground truth may be longer than the flight.
void cut_truth(RunData& data) {
  for (AgentRun& agent : data.agents) {
    StampedPoses during;
    for (const StampedPose& pose : agent.truth) {
      if (pose.stamp_ns >= agent.start_ns && pose.stamp_ns <= agent.end_ns) during.push_back(pose);
    }
    agent.truth = std::move(during);
  }
}

}  // namespace

std::optional<double> flown_s(const AgentRun& agent) {
  if (agent.last_ns <= agent.first_ns) return std::nullopt;
  return seconds_between(agent.first_ns, agent.last_ns);
}

RunData read_run(const fs::path& run) {
  RunData data;
  data.summary = read_run_summary(run / "summary.json");
  const PartReader read(run, data.notes);
  for (const auto& [name, summary] : data.summary.agents) {
    data.agents.push_back(read_agent(run, name, summary, read));
  }
  set_span(data);
  set_time_axes(data);
  cut_truth(data);
  return data;
}

}  // namespace covey
