// SPDX-License-Identifier: Apache-2.0
#include "apps/team_command.h"

#include <spdlog/spdlog.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/agent.h"
#include "apps/config_json.h"
#include "apps/json_file.h"
#include "apps/process_usage.h"
#include "apps/report.h"
#include "apps/run_folder.h"
#include "apps/stop_signal.h"
#include "apps/team.h"
#include "apps/team_summary.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string dataset, out, config_file, thermal;
  std::string mode, exchange;  // empty: as the settings say
  std::string init = "auto", pace = "lockstep";
  std::vector<std::string> agents;
  bool force = false, with_solo = false, unknown_start = false;
};

std::vector<DroneFolder> chosen_drones(const Options& options) {
  const std::vector<DroneFolder> all = find_drones(options.dataset);
  if (options.agents.empty()) return all;
  std::vector<DroneFolder> chosen;
  for (const DroneFolder& drone : all) {
    if (std::find(options.agents.begin(), options.agents.end(), drone.name) !=
        options.agents.end()) {
      chosen.push_back(drone);
    }
  }
  for (const std::string& name : options.agents) {
    const auto known = [&name](const DroneFolder& drone) { return drone.name == name; };
    if (std::none_of(all.begin(), all.end(), known)) {
      std::vector<std::string> names;
      names.reserve(all.size());
      for (const DroneFolder& drone : all) names.push_back(drone.name);
      throw std::runtime_error("no drone '" + name + "' in " + options.dataset + " (there are " +
                               join(names, ", ") + ")");
    }
  }
  return chosen;
}

std::vector<std::string> without_ground_truth(const std::vector<DroneFolder>& drones) {
  std::vector<std::string> names;
  for (const DroneFolder& drone : drones) {
    if (!fs::exists(ground_truth_file(drone.mav0))) names.push_back(drone.name);
  }
  return names;
}

// As the command says, or else the settings, or else what the dataset has.
InitMethod chosen_start(const std::string& init, const AgentConfig& settings,
                        const TeamOptions& team) {
  const bool set = team.config.contains(nlohmann::json::json_pointer("/initialisation/method"));
  if (init == "auto" && set) return settings.initialisation.method;
  if (init == "static") return InitMethod::kStatic;
  if (init == "groundtruth") return InitMethod::kGroundTruth;
  return without_ground_truth(team.drones).empty() ? InitMethod::kGroundTruth : InitMethod::kStatic;
}

// Drones that would believe each other's worlds to be their own.
void warn_of_one_start(const TeamOptions& team) {
  if (team.init != InitMethod::kStatic || team.mode == FlightMode::kSolo || team.unknown_start ||
      team.drones.size() < 2) {
    return;
  }
  const std::vector<std::string> names = without_ground_truth(team.drones);
  if (names.empty()) return;
  spdlog::warn(
      "{}: no ground truth, so taken to start where section initialisation says, one like the "
      "other; where that is not so fly with --unknown-start",
      join(names, ", "));
}

void choose_pace(const std::string& pace, TeamOptions& team) {
  if (pace == "lockstep") return;
  char* end = nullptr;
  const double rate = std::strtod(pace.c_str(), &end);
  if (pace.empty() || *end != '\0' || !(rate >= 0.01 && rate <= 100)) {
    throw CLI::ValidationError("--pace",
                               "'" + pace + "' is neither lockstep nor a rate from 0.01 to 100");
  }
  team.pace = Pace::kRate;
  team.real_time_factor = rate;
}

fs::path default_run(const Options& options, FlightMode mode) {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char stamp[32];
  std::strftime(stamp, sizeof(stamp), "%Y%m%d-%H%M%S", &local);
  const std::string how = mode == FlightMode::kSolo ? "-solo-" : "-collaborative-";
  return fs::path("runs") / (dataset_name(options.dataset) + how + stamp);
}

TeamOptions team_options(const Options& options) {
  TeamOptions team;
  team.drones = chosen_drones(options);
  choose_pace(options.pace, team);
  AgentConfig settings;
  if (!options.config_file.empty()) {
    team.config = read_json_file(options.config_file);
    team.config_name = options.config_file;
    merge_config(team.config, team.config_name, settings);  // before anything is put into them
  }
  team.mode = settings.agent.mode;
  if (!options.mode.empty())
    team.mode = options.mode == "solo" ? FlightMode::kSolo : FlightMode::kCollaborative;
  team.exchange = exchange_from_name(options.exchange).value_or(settings.collaboration.exchange);
  team.out = options.out.empty() ? default_run(options, team.mode) : fs::path(options.out);
  team.init = chosen_start(options.init, settings, team);
  team.unknown_start = options.unknown_start;
  if (!options.thermal.empty()) team.config["thermal"]["mode"] = options.thermal;
  // A mistake in the settings shows now, before anything is started.
  for (const DroneFolder& drone : team.drones) (void)print_config(agent_config(team, drone, 0));
  warn_of_one_start(team);
  return team;
}

// Nothing before there is anything to judge by.
std::string time_left(const FlightProgress& progress) {
  if (progress.flown_s <= 0) return "";
  const double left_s =
      progress.elapsed_s * (progress.total_s - progress.flown_s) / progress.flown_s;
  char text[64];
  std::snprintf(text, sizeof(text), ", about %.0f s left", left_s);
  return text;
}

// On a terminal one line that is written over, otherwise a line now and then.
class ProgressLine {
 public:
  explicit ProgressLine(std::string title) : title_(std::move(title)) {}
  ~ProgressLine() {
    if (on_terminal_ && shown_) std::fprintf(stderr, "\r\033[K");
  }
  ProgressLine(const ProgressLine&) = delete;
  ProgressLine& operator=(const ProgressLine&) = delete;

  void show(const FlightProgress& progress) {
    const double interval_ms = on_terminal_ ? 200 : 10'000;
    const double now_ms = steady_ms();
    if (shown_ && now_ms - last_ms_ < interval_ms) return;
    last_ms_ = now_ms;
    shown_ = true;
    std::fprintf(stderr, "%s%s: %.1f of %.1f s flown%s%s", on_terminal_ ? "\r\033[K" : "",
                 title_.c_str(), progress.flown_s, progress.total_s, time_left(progress).c_str(),
                 on_terminal_ ? "" : "\n");
    std::fflush(stderr);
  }

 private:
  std::string title_;
  const bool on_terminal_ = isatty(STDERR_FILENO) != 0;
  bool shown_ = false;
  double last_ms_ = 0;
};

struct Flown {
  FlightResult flight;
  RunSummary summary;
};

// What the folder held before comes back if nobody flies.
Flown fly(const TeamOptions& team, const Options& options, RunFolder& folder) {
  fs::create_directories(team.out);
  Flown flown;
  {
    ProgressLine line(team.mode == FlightMode::kSolo ? "alone" : "together");
    flown.flight = fly_team(team, [&](const FlightProgress& progress) {
      folder.keep();
      line.show(progress);
    });
  }
  flown.summary = summarize_team(team, flown.flight, options.dataset);
  return flown;
}

void fail_if_incomplete(const FlightResult& flight, const fs::path& run) {
  if (flight.interrupted) {
    throw std::runtime_error("interrupted; what was flown until then is in " + run.string());
  }
  if (flight.ended_early.empty()) return;
  std::vector<std::string> who;
  for (const auto& [name, why] : flight.ended_early) {
    who.push_back(std::string(name).append(" ").append(why));
  }
  throw std::runtime_error(join(who, ", ") + "; the results of the others are in " + run.string());
}

void fail_if_none_started(const RunSummary& run) {
  const bool none = std::all_of(run.agents.begin(), run.agents.end(), [](const auto& agent) {
    return agent.second.not_started.has_value();
  });
  if (!none || run.agents.empty()) return;
  throw std::runtime_error("no drone has started: " + *run.agents.begin()->second.not_started);
}

void run(const Options& options) {
  const TeamOptions team = team_options(options);
  catch_stop_signals();
  RunFolder folder(team.out, options.force);

  std::optional<Flown> alone;
  if (options.with_solo && team.mode == FlightMode::kCollaborative) {
    TeamOptions solo = team;
    solo.mode = FlightMode::kSolo;
    solo.out = team.out / kSoloFolder;
    alone = fly(solo, options, folder);
    fail_if_incomplete(alone->flight, solo.out);
  }
  const Flown flown = fly(team, options, folder);
  std::printf("%s", team_table(flown.summary, alone ? &alone->summary : nullptr).c_str());
  if (flown.summary.real_time_factor) {
    std::printf("%.1f times real time\n", *flown.summary.real_time_factor);
  }
  const fs::path report = write_report(team.out);
  std::printf("report: %s\n", report.c_str());
  std::fflush(stdout);
  fail_if_incomplete(flown.flight, team.out);
  fail_if_none_started(flown.summary);
}

}  // namespace

void add_team_command(CLI::App& covey) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand(
      "team", "Fly all drones of a dataset, one process each, over DDS on this machine");
  command->footer(
      "Example: covey team data/castle --out runs/castle --with-solo\n"
      "         covey team data/castle --mode solo --agents uav0,uav2 --pace 1");
  command->add_option("dataset", options->dataset, "EuRoC folders: DIR/uavK/mav0, or DIR/mav0")
      ->required()
      ->type_name("DIR");
  command->add_option("--out", options->out, "Folder for the results (default: below runs/)")
      ->type_name("RUN");
  command
      ->add_option("--mode", options->mode,
                   "Together, or each for itself (default: as in FILE.json, else collaborative)")
      ->check(CLI::IsMember({"collaborative", "solo"}));
  command
      ->add_option(
          "--exchange", options->exchange,
          "What the drones tell each other: a question per new view and short answers; the "
          "paper's question per image and answers with the whole filter; or the whole "
          "filter to all at every image (default: as in FILE.json, else compact)")
      ->check(CLI::IsMember({"compact", "paper", "naive"}));
  command
      ->add_option("--init", options->init,
                   "Gravity from standing still, or pose and velocity from ground truth; auto: "
                   "ground truth where all drones have it")
      ->check(CLI::IsMember({"auto", "static", "groundtruth"}))
      ->capture_default_str();
  command
      ->add_option("--pace", options->pace,
                   "lockstep: no frame is dropped; RATE: times real time, late frames are dropped")
      ->type_name("lockstep|RATE")
      ->capture_default_str();
  command
      ->add_option("--thermal", options->thermal,
                   "Images as they are, or calibrated as a thermal camera's, whatever sensor.yaml "
                   "says (default: as in FILE.json, else thermal cameras' images are)")
      ->check(CLI::IsMember({"raw", "calibrated"}));
  command->add_flag("--unknown-start", options->unknown_start,
                    "Every drone starts in a world of its own and finds the others' by what both "
                    "have seen");
  command->add_option("--agents", options->agents, "Only these drones, e.g. uav0,uav2")
      ->delimiter(',');
  command
      ->add_option("--config", options->config_file,
                   "Settings for all drones, merged over the defaults (covey agent "
                   "--print-config shows them); names, folders and pace are this command's")
      ->type_name("FILE.json");
  command->add_flag("--with-solo", options->with_solo, "Fly alone first, to compare");
  command->add_flag("--force", options->force, "Replace the results in RUN");
  command->callback([options] { run(*options); });
}

}  // namespace covey
