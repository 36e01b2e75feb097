// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_run.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <utility>

#include "apps/agent.h"
#include "apps/dataset.h"
#include "apps/json_file.h"
#include "apps/lab_figures.h"
#include "apps/lab_flight.h"
#include "apps/process_usage.h"
#include "apps/stop_signal.h"
#include "apps/team.h"
#include "apps/team_summary.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::json;

constexpr char kCellFile[] = "figures.json";  // written last: its cell is finished

std::set<std::string> shared_memory() {
  std::set<std::string> segments;
  std::error_code absent;
  for (const auto& entry : fs::directory_iterator("/dev/shm", absent)) {
    segments.insert(entry.path().filename().string());
  }
  return segments;
}

// Where the drones are, for links whose quality follows their distance.
struct FlownPaths {
  std::vector<GroundTruth> truths;
  TimeNs first_ns = 0;  // stamp of the first image of all

  [[nodiscard]] Eigen::Vector3d position(std::size_t drone, double flown_s) const {
    const GroundTruth& truth = truths[drone];
    const TimeNs stamp_ns = first_ns + nanoseconds(flown_s);
    return ground_truth_at(truth, stamp_ns)
        .value_or(nearest_state(truth, stamp_ns))
        .pose.p_world_imu;
  }
};

FlownPaths read_paths(const std::vector<DroneFolder>& drones) {
  FlownPaths paths;
  for (const DroneFolder& drone : drones) {
    Dataset dataset = read_dataset(drone.mav0);
    if (!dataset.ground_truth) {
      throw std::runtime_error(drone.mav0.string() + " has no ground truth, which 'radio' needs");
    }
    const TimeNs first_ns = dataset.images.front().stamp_ns;
    paths.first_ns = paths.truths.empty() ? first_ns : std::min(paths.first_ns, first_ns);
    paths.truths.push_back(*std::move(dataset.ground_truth));
  }
  return paths;
}

double length_s(const DroneFolder& drone) {
  const std::vector<ImageEntry> images = read_dataset(drone.mav0).images;
  return seconds_between(images.front().stamp_ns, images.back().stamp_ns);
}

class LabRun {
 public:
  LabRun(const LabOptions& options, const std::function<void(const LabProgress&)>& on_progress)
      : options_(options),
        experiment_(options.experiment),
        on_progress_(on_progress),
        drones_(find_drones(options.dataset)) {
    for (int& count : experiment_.grid.drones) {
      if (count == 0) count = static_cast<int>(drones_.size());
    }
    cells_ = cells_of(experiment_);
    require_different(cells_, options.experiment_file.string());
    if (experiment_.seconds > 0) experiment_.config["agent"]["duration_s"] = experiment_.seconds;
    check();
  }

  std::vector<LabOutcome> run() {
    if (experiment_.range.half_range_m > 0) paths_ = read_paths(drones_);
    if (experiment_.fly && experiment_.alone) fly_alone();
    for (const LabCell& cell : cells_) {
      if (!fs::exists(folder_of(cell) / kCellFile)) ++progress_.cells;
    }
    const double start_ms = steady_ms();
    std::vector<LabOutcome> outcomes;
    for (const LabCell& cell : cells_) {
      if (!fs::exists(folder_of(cell) / kCellFile)) {
        ++progress_.cell;
        progress_.elapsed_s = (steady_ms() - start_ms) * 1e-3;
        progress_.doing = cell.name();
        show({});
        fly(cell);
      }
      outcomes.push_back(
          {cell, lab_figures_from_json(read_json_file(folder_of(cell) / kCellFile))});
      write_lab_results(options_.out, experiment_, outcomes);
    }
    return outcomes;
  }

 private:
  void check() const;
  void fly_alone();
  void fly(const LabCell& cell);
  [[nodiscard]] TeamOptions team_of(const LabCell& cell) const;
  [[nodiscard]] std::vector<AgentConfig> agents_of(const LabCell& cell,
                                                   const TeamOptions& team) const;
  [[nodiscard]] NetworkModel network_of(const LabCell& cell) const;
  [[nodiscard]] std::size_t index_of(const std::string& drone) const;
  [[nodiscard]] RunSummary alone(const TeamOptions& team) const;

  [[nodiscard]] fs::path folder_of(const LabCell& cell) const {
    return options_.out / "cells" / cell.name();
  }
  [[nodiscard]] fs::path alone_folder() const { return options_.out / "alone"; }
  void show(const FlightProgress& flight) {
    progress_.flown_s = flight.flown_s;
    progress_.total_s = flight.total_s;
    on_progress_(progress_);
  }

  const LabOptions& options_;
  LabExperiment experiment_;
  const std::function<void(const LabProgress&)>& on_progress_;
  std::vector<DroneFolder> drones_;
  std::vector<LabCell> cells_;
  std::optional<FlownPaths> paths_;
  LabProgress progress_;
};

[[noreturn]] void fail(const LabOptions& options, const std::string& key, const std::string& what) {
  throw std::runtime_error(options.experiment_file.string() + ": '" + key + "' " + what);
}

void LabRun::check() const {
  for (const int count : experiment_.grid.drones) {
    const bool too_many = experiment_.fly && count > static_cast<int>(drones_.size());
    if (count >= 2 && count <= kMaxAgents && !too_many) continue;
    fail(options_, "drones",
         "is " + std::to_string(count) + ", but a team has 2 to " + std::to_string(kMaxAgents) +
             " and " + options_.dataset.string() + " has " + std::to_string(drones_.size()));
  }
  const auto known = [this](const std::string& name) {
    const std::size_t index = index_of(name);
    return std::all_of(experiment_.grid.drones.begin(), experiment_.grid.drones.end(),
                       [index](int count) { return index < static_cast<std::size_t>(count); });
  };
  for (const LabPartition& partition : experiment_.partitions) {
    for (const std::string& name : partition.apart) {
      if (!known(name)) fail(options_, "partitions.apart", "names " + name + ", who does not fly");
    }
    if (!experiment_.fly) continue;
    const double recorded_s = length_s(drones_.front());
    if (partition.from_s >= recorded_s) {
      fail(options_, "partitions.from_s",
           fmt::format("is {} s, but {} is over after {:.1f} s", partition.from_s,
                       options_.dataset.string(), recorded_s));
    }
  }
  for (const LabLink& link : experiment_.links) {
    if (!known(link.from)) fail(options_, "links.from", "is " + link.from + ", who does not fly");
    if (!known(link.to)) fail(options_, "links.to", "is " + link.to + ", who does not fly");
    if (link.from == link.to) fail(options_, "links.to", "is the sender itself");
  }
}

std::size_t LabRun::index_of(const std::string& drone) const {
  const auto found = std::find_if(drones_.begin(), drones_.end(),
                                  [&](const DroneFolder& d) { return d.name == drone; });
  return static_cast<std::size_t>(found - drones_.begin());
}

// More drones than recordings, when nobody flies: several are given the same one.
TeamOptions LabRun::team_of(const LabCell& cell) const {
  TeamOptions team;
  const auto count = static_cast<std::size_t>(cell.drones);
  for (std::size_t i = 0; i < count; ++i) {
    DroneFolder drone = drones_[i % drones_.size()];
    if (count > drones_.size()) drone.name = "uav" + std::to_string(i);
    team.drones.push_back(std::move(drone));
  }
  team.out = folder_of(cell);
  team.exchange = exchange_from_name(cell.exchange).value();
  team.pace = Pace::kRate;
  team.real_time_factor = experiment_.pace;
  team.config = experiment_.config;
  team.config.merge_patch(cell.variant.config);
  team.config_name = options_.experiment_file.string();
  return team;
}

std::vector<AgentConfig> LabRun::agents_of(const LabCell& cell, const TeamOptions& team) const {
  std::vector<AgentConfig> agents;
  for (std::size_t i = 0; i < team.drones.size(); ++i) {
    AgentConfig config = agent_config(team, team.drones[i], 0);
    merge_config(Json{{"link", {{"profile", cell.profile}}}}, team.config_name, config);
    config.link.loopback_only = false;
    config.link.interfaces = {drone_address(i)};
    config.link.initial_peers.clear();
    for (std::size_t other = 0; other < team.drones.size(); ++other) {
      if (other != i) config.link.initial_peers.push_back(drone_address(other));
    }
    agents.push_back(std::move(config));
  }
  return agents;
}

NetworkModel LabRun::network_of(const LabCell& cell) const {
  NetworkModel network;
  network.drones = static_cast<std::size_t>(cell.drones);
  network.quality = cell.quality;
  for (const LabLink& link : experiment_.links) {
    network.special[{index_of(link.from), index_of(link.to)}] = link.quality;
  }
  network.range = experiment_.range;
  if (paths_) {
    network.distance_m = [this](std::size_t a, std::size_t b, double flown_s) {
      return (paths_->position(a % drones_.size(), flown_s) -
              paths_->position(b % drones_.size(), flown_s))
          .norm();
    };
  }
  for (const LabPartition& partition : experiment_.partitions) {
    Partition cut{partition.from_s, partition.until_s, {}};
    for (const std::string& name : partition.apart) cut.apart.push_back(index_of(name));
    network.partitions.push_back(std::move(cut));
  }
  return network;
}

// As fast as the machine can: alone, nothing depends on the pace.
void LabRun::fly_alone() {
  if (fs::exists(alone_folder() / "summary.json")) return;
  TeamOptions team;
  team.drones = drones_;
  team.out = alone_folder();
  team.mode = FlightMode::kSolo;
  team.config = experiment_.config;
  team.config_name = options_.experiment_file.string();
  progress_.doing = "alone";
  const FlightResult flight = fly_team(team, [this](const FlightProgress& p) { show(p); });
  if (flight.interrupted) throw std::runtime_error("interrupted before the first cell");
  if (!flight.ended_early.empty()) {
    throw std::runtime_error("flying alone, " + flight.ended_early.begin()->first + " " +
                             flight.ended_early.begin()->second);
  }
  (void)summarize_team(team, flight, options_.dataset);
}

RunSummary LabRun::alone(const TeamOptions& team) const {
  RunSummary run = read_run_summary(alone_folder() / "summary.json");
  std::map<std::string, AgentSummary> members;
  for (const DroneFolder& drone : team.drones) members[drone.name] = run.agents.at(drone.name);
  run.agents = std::move(members);
  return run;
}

void write_memory(const fs::path& file, const std::vector<LabMemory>& memory) {
  std::string csv = "drone,at_s,memory_mib\n";
  for (const LabMemory& sample : memory) {
    csv +=
        sample.drone + ',' + std::to_string(sample.at_s) + ',' + std::to_string(sample.mib) + '\n';
  }
  write_whole_file(file, csv);
}

void LabRun::fly(const LabCell& cell) {
  const TeamOptions team = team_of(cell);
  fs::remove_all(team.out);  // of a run that was interrupted
  const LabFlightPlan plan{agents_of(cell, team),
                           experiment_.fly,
                           experiment_.settle_s,
                           experiment_.hold_s,
                           experiment_.pace,
                           experiment_.kills,
                           cell.seed};
  const std::set<std::string> before = shared_memory();
  LabFlightResult flight;
  {
    DroneNetwork network(network_of(cell), cell.seed);
    flight = fly_in_lab(plan, network, [this](const FlightProgress& p) { show(p); });
  }
  if (flight.flight.interrupted) {
    throw std::runtime_error("interrupted; the same command goes on where it was (" +
                             options_.out.string() + ")");
  }
  for (const auto& [drone, why] : flight.flight.ended_early) {
    spdlog::warn("{}: {} {}", cell.name(), drone, why);
  }
  LabEvidence evidence{experiment_, flight, team.out, {}, {}, {}, alone_folder()};
  if (experiment_.fly) {
    write_memory(team.out / "memory.csv", flight.memory);
    FlightResult ends = flight.flight;
    for (const LabKill& kill : flight.kills) ends.ended_early.emplace(kill.drone, "was killed");
    evidence.together = summarize_team(team, ends, options_.dataset);
    if (experiment_.alone) evidence.alone = alone(team);
    evidence.exchange = read_exchange_logs(team.out);
  }
  LabFigures figures = judge(evidence);
  const std::set<std::string> after = shared_memory();
  figures.shared_memory_left =
      static_cast<double>(std::count_if(after.begin(), after.end(), [&](const std::string& name) {
        return before.count(name) == 0;
      }));
  write_json_file(team.out / kCellFile, to_json(figures));
}

}  // namespace

void check_lab(const LabOptions& options) { (void)LabRun(options, {}); }

std::vector<LabOutcome> run_lab(const LabOptions& options,
                                const std::function<void(const LabProgress&)>& on_progress) {
  return LabRun(options, on_progress).run();
}

}  // namespace covey
