// SPDX-License-Identifier: Apache-2.0
#include "apps/agent_command.h"

#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>

#include "apps/agent.h"
#include "apps/collected_run.h"
#include "apps/stop_signal.h"

namespace covey {
namespace {

struct Options {
  std::string config_file, name, dataset, out, thermal;
  int control_fd = -1, team_of = 0;
  bool print_config = false, describe_config = false, is_flying = false;
};

AgentConfig configuration(const Options& options) {
  AgentConfig config;
  if (!options.config_file.empty()) config = read_config(options.config_file);
  if (!options.name.empty()) config.agent.name = options.name;
  if (!options.dataset.empty()) config.agent.dataset = options.dataset;
  if (!options.out.empty()) config.agent.out = options.out;
  if (options.team_of > 0) {
    config.agent.wait_for_peers = options.team_of - 1;
    config.link.max_agents = std::max(config.link.max_agents, options.team_of);
    config.link.team_size = options.team_of;
  }
  config.thermal.mode = thermal_mode_from_name(options.thermal).value_or(config.thermal.mode);
  return config;
}

void fly(const Options& options) {
  if (options.config_file.empty() && options.dataset.empty()) {
    throw CLI::RequiredError("--config or --dataset");
  }
  const AgentConfig config = configuration(options);
  catch_stop_signals();
  std::optional<int> control_fd;
  if (options.control_fd >= 0) control_fd = options.control_fd;
  spdlog::set_pattern(config.agent.name + ": %l: %v");
  try {
    if (run_agent(config, control_fd)) return;
  } catch (const std::exception& error) {
    throw std::runtime_error(config.agent.name + ": " + error.what());
  }
  if (control_fd) throw CLI::RuntimeError(1);  // the team knows
  throw std::runtime_error(config.agent.name + ": stopped before the end; what was flown is in " +
                           config.agent.out);
}

void require_flying(const std::string& folder) {
  constexpr double kMaxSilence_s = 10;
  if (silent_for_s(folder) > kMaxSilence_s)
    throw std::runtime_error(folder + ": its drone has not written its status for 10 s");
}

void run(const Options& options) {
  if (options.is_flying) {
    if (options.out.empty()) throw CLI::RequiredError("--out");
    require_flying(options.out);
  } else if (options.describe_config) {
    std::printf("%s", describe_config().c_str());
  } else if (options.print_config) {
    std::printf("%s", print_config(configuration(options)).c_str());
  } else {
    fly(options);
  }
}

}  // namespace

void add_agent_command(CLI::App& covey) {
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      covey.add_subcommand("agent", "One drone, one process: what runs in its container");
  command->footer(
      "Example: covey agent --print-config > uav0.json      every setting with its default\n"
      "         covey agent --config uav0.json --dataset data/castle/uav0/mav0 --out runs/uav0");
  command->add_option("--config", options->config_file, "Settings; those not given have defaults")
      ->type_name("FILE.json");
  command->add_option("--name", options->name, "Instead of agent.name");
  command->add_option("--dataset", options->dataset, "Instead of agent.dataset")->type_name("MAV0");
  command->add_option("--out", options->out, "Instead of agent.out")->type_name("DIR");
  command
      ->add_option("--team-of", options->team_of,
                   "Drones in the team, this one included: waits for the others")
      ->check(CLI::Range(1, kMaxAgents));
  command->add_option("--thermal", options->thermal, "Instead of thermal.mode")
      ->check(CLI::IsMember({"raw", "calibrated"}));
  command->add_flag("--print-config", options->print_config, "Print every setting as JSON");
  command->add_flag("--describe-config", options->describe_config,
                    "Print every key with its default, range, meaning and unit");
  command->add_flag("--is-flying", options->is_flying,
                    "Flies nothing: fails if the drone that writes to --out has gone silent");
  command->add_option("--control-fd", options->control_fd, "Descriptor on which a team commands")
      ->group("");
  command->callback([options] { run(*options); });
}

}  // namespace covey
