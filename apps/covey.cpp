// SPDX-License-Identifier: Apache-2.0
//
// covey: one program, one subcommand for each job.
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <opencv2/core/utility.hpp>
#include <stdexcept>
#include <string>

#include "apps/agent_command.h"
#include "apps/evaluate_command.h"
#include "apps/import_command.h"
#include "apps/inspect_command.h"
#include "apps/keys_command.h"
#include "apps/lab_command.h"
#include "apps/link_worker.h"
#include "apps/places_command.h"
#include "apps/play_command.h"
#include "apps/qos_command.h"
#include "apps/report_command.h"
#include "apps/simulate_command.h"
#include "apps/study_command.h"
#include "apps/tables_command.h"
#include "apps/team_command.h"
#include "apps/train_vocabulary_command.h"

namespace {

constexpr int kFailure = 1, kBadUsage = 2;

// A file of results that got the number of a closed stream would take what is said there.
void open_closed_streams() {
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (::fcntl(stream, F_GETFD) < 0) (void)::open("/dev/null", O_RDWR);
}

std::string one_line(std::string text) {
  while (!text.empty() && text.back() == '\n') text.pop_back();
  for (char& c : text) c = c == '\n' ? ' ' : c;
  return text;
}

// Which command's help has the answer.
std::string help_hint(const CLI::App& covey) {
  const auto used = covey.get_subcommands();
  return used.empty() ? "covey --help" : "covey " + used.front()->get_name() + " --help";
}

int run(CLI::App& covey, int argc, char** argv) {
  try {
    covey.parse(argc, argv);
    return 0;
  } catch (const CLI::RuntimeError& error) {
    return error.get_exit_code();
  } catch (const CLI::Success& help) {
    return covey.exit(help);
  } catch (const CLI::ParseError& error) {
    if (argc > 1 && covey.get_subcommands().empty()) {
      std::fprintf(stderr, "covey: no %s '%s' (see covey --help)\n",
                   argv[1][0] == '-' ? "option" : "command", argv[1]);
      return kBadUsage;
    }
    std::fprintf(stderr, "covey: %s (see %s)\n", one_line(error.what()).c_str(),
                 help_hint(covey).c_str());
    return kBadUsage;
  }
}

int run(int argc, char** argv) {
  cv::setNumThreads(1);  // drones share the machine's cores
  spdlog::set_default_logger(spdlog::stderr_color_mt("covey"));
  spdlog::set_pattern("covey: %l: %v");

  CLI::App covey("Collaborative visual and thermal inertial odometry for teams of drones", "covey");
  covey.require_subcommand(1);
  covey.set_version_flag("--version", "covey " COVEY_VERSION);
  covey::add_simulate_command(covey);
  covey::add_team_command(covey);
  covey::add_agent_command(covey);
  covey::add_play_command(covey);
  covey::add_import_command(covey);
  covey::add_evaluate_command(covey);
  covey::add_report_command(covey);
  covey::add_inspect_command(covey);
  covey::add_train_vocabulary_command(covey);
  covey::add_places_command(covey);
  covey::add_tables_command(covey);
  covey::add_study_command(covey);
  covey::add_qos_command(covey);
  covey::add_keys_command(covey);
  covey::add_lab_command(covey);
  covey::add_link_command(covey);
  return run(covey, argc, argv);
}

// Of a pipe: it has heard what it wanted to.
bool reader_has_left() {
  pollfd out{STDOUT_FILENO, POLLOUT, 0};
  return ::poll(&out, 1, 0) == 1 && (out.revents & POLLERR) != 0;
}

void require_whole_output() {
  const bool whole = std::fflush(stdout) == 0 && std::ferror(stdout) == 0;
  if (!whole && !reader_has_left())
    throw std::runtime_error("standard output: cannot be written: is the disk full?");
}

}  // namespace

int main(int argc, char** argv) {
  open_closed_streams();
  ::signal(SIGXFSZ, SIG_IGN);  // a file that may not grow is an error like a full disk, no death
  try {
    const int exit_code = run(argc, argv);
    require_whole_output();
    return exit_code;
  } catch (const std::filesystem::filesystem_error& error) {
    std::fprintf(stderr, "covey: %s: %s\n", error.path1().c_str(), error.code().message().c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "covey: %s\n", one_line(error.what()).c_str());
  } catch (...) {
    std::fputs("covey: failed for an unknown reason\n", stderr);
  }
  return kFailure;
}
