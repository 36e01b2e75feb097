// SPDX-License-Identifier: Apache-2.0
#include "tests/apps/command_run.h"

#include <CLI/CLI.hpp>
#include <exception>

#include "apps/evaluate_command.h"
#include "apps/import_command.h"
#include "apps/inspect_command.h"
#include "apps/simulate_command.h"
#include "apps/train_vocabulary_command.h"

namespace covey {

void run_command(const std::string& arguments) {
  CLI::App covey;
  add_evaluate_command(covey);
  add_import_command(covey);
  add_inspect_command(covey);
  add_simulate_command(covey);
  add_train_vocabulary_command(covey);
  covey.parse(arguments, false);
}

std::string complaint_of(const std::string& arguments) {
  try {
    run_command(arguments);
    return "";
  } catch (const std::exception& error) {
    return error.what();
  }
}

}  // namespace covey
