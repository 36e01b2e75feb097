// SPDX-License-Identifier: Apache-2.0
#include "apps/team_summary.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "apps/agent.h"
#include "apps/trajectory_file.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

// A process that was killed may have left half a line.
void drop_incomplete_line(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  const std::string content(std::istreambuf_iterator<char>(stream), {});
  const std::size_t end = content.rfind('\n');
  const std::size_t whole = end == std::string::npos ? 0 : end + 1;
  if (fs::exists(file) && whole < content.size()) fs::resize_file(file, whole);
}

void salvage(const fs::path& folder) {
  for (const char* name : {kTrajectoryFile, kCovarianceFile, kTimingsFile, kLinkFile}) {
    drop_incomplete_line(folder / name);
  }
}

// What a drone that was killed can still tell.
AgentSummary from_timings(const std::vector<TimingRecord>& timings) {
  AgentSummary summary;
  summary.frames = static_cast<std::int64_t>(timings.size());
  return summary;
}

std::optional<Trajectory> ground_truth_of(const DroneFolder& drone) {
  const fs::path file = drone.mav0 / "state_groundtruth_estimate0" / "data.csv";
  if (!fs::exists(file)) return std::nullopt;
  return to_trajectory(read_ground_truth(file));
}

// Empty before the drone has started.
Trajectory estimate_in(const fs::path& folder) {
  const fs::path file = folder / kTrajectoryFile;
  std::ifstream stream(file);
  std::string line;
  while (std::getline(stream, line)) {
    if (!line.empty() && line[0] != '#') return read_trajectory(file);
  }
  return {};
}

void evaluate(const DroneFolder& drone, const fs::path& folder, AgentSummary& summary) {
  const Trajectory estimate = estimate_in(folder);
  const std::optional<Trajectory> truth = ground_truth_of(drone);
  if (truth) write_tum(folder / kGroundTruthFile, *truth);
  if (estimate.empty()) {
    spdlog::warn("{} left no trajectory: it had not started yet", drone.name);
    return;
  }
  summary.distance_m = path_length_m(estimate);
  if (!truth) return;
  try {
    summary.accuracy =
        summarize_accuracy(estimate, *truth, read_covariances(folder / kCovarianceFile));
    const auto pairs = associate(estimate, *truth, AssociationOptions());
    summary.distance_m = path_length_m(pairs);
  } catch (const std::exception& error) {
    spdlog::warn("{} cannot be evaluated: {}", drone.name, error.what());
  }
}

AgentSummary summarize_drone(const DroneFolder& drone, const fs::path& folder,
                             const std::optional<std::string>& ended_early) {
  const fs::path file = folder / kAgentSummaryFile;
  if (ended_early) salvage(folder);
  std::vector<TimingRecord> timings;
  if (fs::exists(folder / kTimingsFile) && fs::file_size(folder / kTimingsFile) > 0) {
    timings = read_timings(folder / kTimingsFile);
  }
  AgentSummary summary = fs::exists(file)
                             ? agent_summary_from_json(read_json_file(file), file.string())
                             : from_timings(timings);
  summary.stage_ms = summarize_stages(timings);
  evaluate(drone, folder, summary);
  summary.incomplete = ended_early;
  return summary;
}

template <typename Number>
std::string cell(const char* format, const std::optional<Number>& value) {
  return value ? fmt::format(fmt::runtime(format), *value) : "-";
}

std::optional<double> ate(const AgentSummary& agent, AteSummary AccuracySummary::*alignment) {
  if (!agent.accuracy) return std::nullopt;
  return (*agent.accuracy.*alignment).rmse;
}

std::string table_line(const std::string& name, const AgentSummary& agent,
                       const AgentSummary* alone) {
  const auto metres = [](const std::optional<double>& value) { return cell("{:.3f}", value); };
  std::string line = fmt::format(
      "{:<8} {:>6} {:>7} {:>8} {:>8} {:>8}", name, agent.frames, cell("{:.1f}", agent.distance_m),
      metres(ate(agent, &AccuracySummary::none)), metres(ate(agent, &AccuracySummary::posyaw)),
      metres(ate(agent, &AccuracySummary::se3)));
  if (alone != nullptr) {
    line += fmt::format(" {:>9}", metres(ate(*alone, &AccuracySummary::se3)));
  }
  std::optional<double> rotation_deg, nees;
  if (agent.accuracy) rotation_deg = agent.accuracy->rotation_none_deg;
  if (agent.accuracy) nees = agent.accuracy->nees_position;
  line +=
      fmt::format(" {:>8} {:>6} {:>9} {:>7}", cell("{:.2f}", rotation_deg), cell("{:.1f}", nees),
                  cell("{:.1f}", agent.cpu_ms_per_frame), cell("{:.0f}", agent.max_rss_mib));
  if (agent.link) {
    const MessageSummary& message = agent.link->message;
    line +=
        fmt::format(" {:>9} {:>16}", fmt::format("{}/{}", agent.link->request.sent, message.sent),
                    fmt::format("{}/{}/{}/{}", message.received, message.fused, message.gated,
                                message.rejected));
  }
  if (agent.incomplete) line += "  " + *agent.incomplete;
  return line + "\n";
}

}  // namespace

RunSummary summarize_team(const TeamOptions& options, const FlightResult& flight,
                          const std::string& dataset_name) {
  RunSummary run;
  run.dataset = dataset_name;
  run.mode = options.mode == FlightMode::kSolo ? "solo" : "collaborative";
  if (options.mode == FlightMode::kCollaborative) run.exchange = to_string(options.exchange);
  run.init = options.init == InitMethod::kStatic ? "static" : "groundtruth";
  if (flight.elapsed_s > 0) run.real_time_factor = flight.recorded_s / flight.elapsed_s;
  for (const DroneFolder& drone : options.drones) {
    const auto early = flight.ended_early.find(drone.name);
    std::optional<std::string> why;
    if (flight.interrupted) why = "interrupted";
    if (early != flight.ended_early.end()) why = early->second;
    run.agents[drone.name] = summarize_drone(drone, options.out / drone.name, why);
  }
  write_run_summary(options.out / "summary.json", run);
  return run;
}

std::string team_table(const RunSummary& run, const RunSummary* alone) {
  std::string table = fmt::format("{:<8} {:>6} {:>7} {:>8} {:>8} {:>8}", "drone", "frames",
                                  "path m", "ATE none", "posyaw", "se3 m");
  if (alone != nullptr) table += fmt::format(" {:>9}", "se3 alone");
  table += fmt::format(" {:>8} {:>6} {:>9} {:>7}", "rot. deg", "NEES", "CPU ms/fr", "MiB");
  if (run.mode == "collaborative") {
    table += fmt::format(" {:>9} {:>16}", "asked/ans", "got/fus/gat/rej");
  }
  table += "\n";
  for (const auto& [name, agent] : run.agents) {
    const AgentSummary* reference = nullptr;
    if (alone != nullptr) {
      const auto found = alone->agents.find(name);
      if (found != alone->agents.end()) reference = &found->second;
    }
    table += table_line(name, agent, reference);
  }
  return table;
}

}  // namespace covey
