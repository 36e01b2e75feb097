// SPDX-License-Identifier: Apache-2.0
#include "apps/report_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "apps/report.h"

namespace covey {

void add_report_command(CLI::App& covey) {
  CLI::App* command =
      covey.add_subcommand("report", "Draw RUN/report.html again from a run's files");
  command->footer("Example: covey report runs/castle_around");
  const auto run = std::make_shared<std::string>();
  command->add_option("run", *run, "Folder of a run, as `covey team` writes it")
      ->required()
      ->type_name("RUN");
  command->callback([run] { std::printf("%s\n", write_report(*run).c_str()); });
}

}  // namespace covey
