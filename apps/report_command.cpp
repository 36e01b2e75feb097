// SPDX-License-Identifier: Apache-2.0
#include "apps/report_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>

#include "apps/collected_run.h"
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
    wait_for_end(collected, *options.silence_s);
  }
  std::printf("%s", team_table(summarize_collected(collected), nullptr).c_str());
}

void run(const Options& options) {
  if (!options.dataset.empty()) collect(options);
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
      ->add_option("--wait", options->silence_s,
                   "First waits until all have ended, or said nothing for so many seconds")
      ->check(CLI::Range(0.1, 1e6))
      ->needs(dataset);
  command->callback([options] { run(*options); });
}

}  // namespace covey
