// SPDX-License-Identifier: Apache-2.0
#include "apps/report_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>

#include "apps/collected_run.h"
#include "apps/number_range.h"
#include "apps/report.h"
#include "apps/stop_signal.h"
#include "apps/team_summary.h"

namespace covey {
namespace {

struct Options {
  std::string run, dataset, config_file;
  std::optional<double> silence_s;
};

// Drones in containers have no team that sums up for them.
void collect(const Options& options) {
  const CollectedRun collected{options.run, options.dataset, options.config_file};
  if (options.silence_s) {
    catch_stop_signals();
    wait_for_end(collected, {std::filesystem::file_time_type::clock::now(), *options.silence_s});
  }
  std::printf("%s", team_table(summarize_collected(collected), nullptr).c_str());
}

// As what drones that flew by themselves leave, or a team that was killed.
void require_summary(const std::filesystem::path& run) {
  if (!std::filesystem::is_directory(run) || std::filesystem::exists(run / "summary.json")) return;
  throw std::runtime_error((run / "summary.json").string() +
                           ": is not there; of drones that flew by themselves, or whose team was "
                           "killed, it is made with --dataset DIR");
}

void run(const Options& options) {
  if (!options.dataset.empty()) collect(options);
  require_summary(options.run);
  std::printf("%s\n", write_report(options.run).c_str());
}

}  // namespace

void add_report_command(CLI::App& covey) {
  CLI::App* command =
      covey.add_subcommand("report", "Draw RUN/report.html again from a run's files");
  command->footer(
      "Example: covey report runs/castle_around\n"
      "         covey report runs/compose --dataset data/castle --wait 10    of drones in "
      "containers");
  const auto options = std::make_shared<Options>();
  command->add_option("run", options->run, "Folder of a run, as `covey team` writes it")
      ->required()
      ->type_name("RUN");
  CLI::Option* dataset =
      command
          ->add_option("--dataset", options->dataset,
                       "What the drones in RUN flew, each by itself: evaluates them first and "
                       "writes RUN/summary.json")
          ->type_name("DIR");
  command->add_option("--config", options->config_file, "The settings that they flew with")
      ->type_name("FILE.json")
      ->needs(dataset);
  command
      ->add_option(
          "--wait", options->silence_s,
          "First waits until all have ended, or said nothing for so many seconds; a minute "
          "more for the first to come")
      ->check(NumberRange(0.1, 1e6))
      ->needs(dataset);
  command->callback([options] { run(*options); });
}

}  // namespace covey
