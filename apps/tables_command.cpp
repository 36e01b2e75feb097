// SPDX-License-Identifier: Apache-2.0
#include "apps/tables_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <string>

#include "apps/results.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

struct Options {
  std::string runs, out;
  ResultsOrigin origin;
};

}  // namespace

void add_tables_command(CLI::App& covey) {
  auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand(
      "tables", "Put runs with all exchanges into the paper's tables (scripts/tables does it all)");
  command->footer(
      "Example: covey tables runs/tables --out results.md --commit $(git rev-parse --short HEAD) "
      "\\\n"
      "             --machine 'two cores' --command scripts/tables\n"
      "Reads RUNS/<scenario>-<seed>/{compact,paper,naive}; compact flown with --with-solo, and of\n"
      "drones with thermal cameras once more in raw, with --thermal raw.");
  command->add_option("runs", options->runs, "Folder of the runs")->required()->type_name("RUNS");
  command->add_option("--out", options->out, "Markdown to write")->required()->type_name("FILE");
  command->add_option("--commit", options->origin.commit, "Of the program that flew")->required();
  command->add_option("--machine", options->origin.machine, "That it flew on")->required();
  command->add_option("--command", options->origin.command, "That makes the page")->required();
  command->callback([options] {
    require_writable(options->out);
    write_whole_file(options->out, results_page(read_results(options->runs), options->origin));
    std::printf("%s\n", options->out.c_str());
  });
}

}  // namespace covey
