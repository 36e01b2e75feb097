// SPDX-License-Identifier: Apache-2.0
#include "apps/team_summary.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>

#include "apps/agent.h"
#include "apps/json_file.h"
#include "apps/trajectory_file.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

void drop_incomplete_line(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  const std::string content(std::istreambuf_iterator<char>(stream), {});
  const std::size_t end = content.rfind('\n');
  const std::size_t whole = end == std::string::npos ? 0 : end + 1;
  if (fs::exists(file) && whole < content.size()) fs::resize_file(file, whole);
}

// What a drone that was killed can still tell.
AgentSummary from_timings(const std::vector<TimingRecord>& timings) {
  AgentSummary summary;
  summary.frames = static_cast<std::int64_t>(timings.size());
  return summary;
}

std::optional<StampedPoses> ground_truth_of(const DroneFolder& drone) {
  const fs::path file = ground_truth_file(drone.mav0);
  if (!fs::exists(file)) return std::nullopt;
  return to_trajectory(read_ground_truth(file));
}

// Empty before the drone has started.
StampedPoses estimate_in(const fs::path& folder) {
  const fs::path file = folder / kTrajectoryFile;
  std::ifstream stream(file);
  std::string line;
  while (std::getline(stream, line)) {
    if (!line.empty() && line[0] != '#') return read_trajectory(file);
  }
  return {};
}

struct LevelFrame {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  double yaw_deg = 0;

  [[nodiscard]] Eigen::Vector3d operator*(const Eigen::Vector3d& x) const {
    return p + Eigen::AngleAxisd(yaw_deg * M_PI / 180, Eigen::Vector3d::UnitZ()) * x;
  }
};

Eigen::Vector3d vector_from(const nlohmann::json& json) {
  return {json.at(0).get<double>(), json.at(1).get<double>(), json.at(2).get<double>()};
}

LevelFrame frame_from(const nlohmann::json& json) {
  return {vector_from(json.at("position_m")), json.at("yaw_deg").get<double>()};
}

// What `read` takes from a drone's own summary.
template <typename Read>
auto from_agent_summary(const fs::path& folder, const Read& read) {
  const fs::path file = folder / kAgentSummaryFile;
  const nlohmann::json told = read_json_file(file);
  try {
    return read(told);
  } catch (const nlohmann::json::exception& error) {
    throw std::runtime_error(file.string() + ": is not as covey agent writes it: " + error.what());
  }
}

LevelFrame own_world_of(const fs::path& folder) {
  return from_agent_summary(
      folder, [](const nlohmann::json& told) { return frame_from(told.at("own_world")); });
}

// A peer's, as the drone has found it.
struct FoundWorld {
  LevelFrame T_own_peer;
  Eigen::Vector3d p_peer = Eigen::Vector3d::Zero();  // where it knows it best
  double position_sigma_m = 0, yaw_sigma_deg = 0;
};

std::map<std::string, FoundWorld> found_worlds_of(const fs::path& folder) {
  return from_agent_summary(folder, [](const nlohmann::json& told) {
    std::map<std::string, FoundWorld> worlds;
    for (const auto& item : told.at("peer_worlds").items()) {
      const nlohmann::json& found = item.value();
      worlds[item.key()] = {frame_from(found), vector_from(found.at("at_m")),
                            found.at("position_sigma_m").get<double>(),
                            found.at("yaw_sigma_deg").get<double>()};
    }
    return worlds;
  });
}

// The truth as the drone's own world has it, which lies at its start if it knows no other.
StampedPoses in_own_world(StampedPoses truth, const fs::path& folder) {
  if (!fs::exists(folder / kAgentSummaryFile)) return truth;
  const LevelFrame own = own_world_of(folder);
  const Eigen::Quaterniond turn(
      Eigen::AngleAxisd(-own.yaw_deg * M_PI / 180, Eigen::Vector3d::UnitZ()));
  for (StampedPose& known : truth) {
    known.pose.p_world_imu = turn * (known.pose.p_world_imu - own.p);
    known.pose.q_world_imu = turn * known.pose.q_world_imu;
  }
  return truth;
}

// Throws where a file is broken, or truth and estimate are of other times.
void evaluate(const DroneFolder& drone, const fs::path& folder, AgentSummary& summary) {
  const StampedPoses estimate = estimate_in(folder);
  std::optional<StampedPoses> truth = ground_truth_of(drone);
  if (truth) truth = in_own_world(*std::move(truth), folder);
  if (truth) write_tum(folder / kGroundTruthFile, *truth);
  if (estimate.empty()) {
    spdlog::warn("{} left no trajectory: {}", drone.name,
                 summary.not_started.value_or("it had not started yet"));
    return;
  }
  summary.distance_m = path_length_m(estimate);
  if (!truth) return;
  summary.accuracy =
      summarize_accuracy(estimate, *truth, read_covariances(folder / kCovarianceFile));
  const auto pairs = associate(estimate, *truth, AssociationOptions());
  summary.distance_m = path_length_m(pairs);
}

std::vector<TimingRecord> timings_in(const fs::path& folder) {
  const fs::path file = folder / kTimingsFile;
  if (!fs::exists(file) || fs::file_size(file) == 0) return {};
  return read_timings(file);
}

AgentSummary own_summary(const fs::path& folder, const std::vector<TimingRecord>& timings) {
  const fs::path file = folder / kAgentSummaryFile;
  if (!fs::exists(file)) return from_timings(timings);
  return agent_summary_from_json(read_json_file(file), file.string());
}

// What one drone has left broken costs itself its figures, and nobody else the report.
AgentSummary summarize_drone(const DroneFolder& drone, const fs::path& folder,
                             const std::optional<std::string>& ended_early) {
  if (ended_early) drop_incomplete_lines(folder);
  std::vector<TimingRecord> timings;
  try {
    timings = timings_in(folder);
  } catch (const std::exception& error) {
    spdlog::warn("{}: {}", drone.name, error.what());
  }
  AgentSummary summary;
  try {
    summary = own_summary(folder, timings);
  } catch (const std::exception& error) {
    summary = from_timings(timings);
    summary.incomplete = error.what();
  }
  summary.stage_ms = summarize_stages(timings);
  try {
    evaluate(drone, folder, summary);
  } catch (const std::exception& error) {
    spdlog::warn("{} cannot be evaluated: {}", drone.name, error.what());
  }
  if (ended_early) summary.incomplete = ended_early;  // else what the drone itself says
  return summary;
}

AlignmentSummary judge(const FoundWorld& found, const LevelFrame& own, const LevelFrame& peer) {
  AlignmentSummary alignment;
  alignment.position_error_m =
      (own * (found.T_own_peer * found.p_peer) - peer * found.p_peer).norm();
  alignment.yaw_error_deg =
      std::abs(std::remainder(own.yaw_deg + found.T_own_peer.yaw_deg - peer.yaw_deg, 360.0));
  alignment.position_sigma_m = found.position_sigma_m;
  alignment.yaw_sigma_deg = found.yaw_sigma_deg;
  return alignment;
}

// Of the worlds that a drone has found: each against where the peer's really lies, as far as the
// peer has told it here. It may have left nothing, or be of another team's dataset.
std::map<std::string, AlignmentSummary> judge_alignments(const fs::path& run,
                                                         const std::string& drone) {
  std::map<std::string, AlignmentSummary> alignments;
  const LevelFrame own = own_world_of(run / drone);
  for (const auto& [name, found] : found_worlds_of(run / drone)) {
    try {
      alignments[name] = judge(found, own, own_world_of(run / name));
    } catch (const std::exception& error) {
      spdlog::warn("{} has found {}'s world, which cannot be judged: {}", drone, name,
                   error.what());
    }
  }
  return alignments;
}

void judge_alignments(const fs::path& run, std::map<std::string, AgentSummary>& agents) {
  for (auto& [name, agent] : agents) {
    try {
      agent.alignments = judge_alignments(run, name);
    } catch (const std::exception& error) {
      spdlog::warn("{}: nothing is known of its world: {}", name, error.what());
    }
  }
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
    const std::int64_t restarts = restart_count(*agent.link);
    if (restarts > 0) line += fmt::format("  link restarted {} times", restarts);
  }
  if (agent.incomplete) line += "  " + *agent.incomplete;
  if (agent.not_started) line += "  did not start: " + *agent.not_started;
  for (const auto& [file, lines] : agent.lost_lines)
    line += fmt::format("  {} lines of {} lost", lines, file);
  return line + "\n";
}

// Together over alone, of the drones that have both; empty where none has.
std::string gain_line(const RunSummary& run, const RunSummary& alone) {
  double aligned = 0, aligned_alone = 0, unaligned = 0, unaligned_alone = 0;
  for (const auto& [name, agent] : run.agents) {
    const auto solo = alone.agents.find(name);
    if (solo == alone.agents.end() || !agent.accuracy || !solo->second.accuracy) continue;
    aligned += agent.accuracy->se3.rmse;
    aligned_alone += solo->second.accuracy->se3.rmse;
    unaligned += agent.accuracy->none.rmse;
    unaligned_alone += solo->second.accuracy->none.rmse;
  }
  if (aligned_alone <= 0 || unaligned_alone <= 0) return "";
  return fmt::format("together over alone, mean errors: {:.2f} aligned, {:.2f} as they stand\n",
                     aligned / aligned_alone, unaligned / unaligned_alone);
}

std::string legend(const RunSummary& run) {
  const bool truth = std::any_of(run.agents.begin(), run.agents.end(), [](const auto& agent) {
    return agent.second.accuracy.has_value();
  });
  std::string text;
  if (truth) {
    text +=
        "RMSE of positions in m: as they stand (ATE none), position and yaw fitted (posyaw), SE3\n"
        "fitted (se3). NEES of the position: about 3 for a drone that is as wrong as it says.\n";
  }
  if (run.mode == "collaborative") {
    text +=
        "Questions asked, messages sent; messages got, and how many of them were answers that "
        "were\n"
        "fused, gated or rejected: the others tell what came of the drone's own answers.\n";
  }
  return text;
}

}  // namespace

void drop_incomplete_lines(const fs::path& folder) {
  for (const std::string name : kRunFiles) {
    if (name != kPicturesFile) drop_incomplete_line(folder / name);
  }
}

RunSummary summarize_team(const TeamOptions& options, const FlightResult& flight,
                          const fs::path& dataset) {
  RunSummary run;
  run.dataset = dataset_name(dataset);
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
  const bool all_ended = !flight.interrupted && flight.ended_early.empty();
  if (options.unknown_start && options.mode == FlightMode::kCollaborative && all_ended) {
    judge_alignments(options.out, run.agents);
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
    table += fmt::format(" {:>9} {:>16}", "asked/sent", "got/fus/gat/rej");
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
  table += legend(run);
  if (alone != nullptr) table += gain_line(run, *alone);
  for (const auto& [name, agent] : run.agents) {
    if (!agent.alignments) continue;
    if (agent.alignments->empty()) table += name + " has found nobody's world\n";
    for (const auto& [peer, alignment] : *agent.alignments) {
      table += fmt::format("{} has found {}'s world to {:.3f} m and {:.2f} deg\n", name, peer,
                           alignment.position_error_m, alignment.yaw_error_deg);
    }
  }
  return table;
}

}  // namespace covey
