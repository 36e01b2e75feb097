// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_command.h"

#include <unistd.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>

#include "apps/child_process.h"
#include "apps/config_file.h"
#include "apps/drone_network.h"
#include "apps/json_file.h"
#include "apps/lab_run.h"
#include "apps/process_usage.h"
#include "apps/stop_signal.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

// In the folder of the results: what they are of.
constexpr char kExperimentFile[] = "experiment.json";
constexpr char kDatasetFile[] = "dataset.json";  // which folder; none: simulated

struct Options {
  std::string experiment, dataset, out;
};

// One that is there; empty where it is to be simulated.
fs::path given_dataset(const Options& options, const LabExperiment& experiment) {
  const std::string& folder = options.dataset.empty() ? experiment.dataset : options.dataset;
  if (!folder.empty()) return fs::absolute(folder);
  if (!experiment.scenario.empty()) return "";
  throw std::runtime_error(options.experiment +
                           ": 'dataset' or 'scenario' is missing, and no --dataset is given");
}

void require_same(const fs::path& kept, const nlohmann::json& wanted, const std::string& what) {
  if (!fs::exists(kept) || read_json_file(kept) == wanted) return;
  throw std::runtime_error(kept.parent_path().string() + " holds the results of another " + what +
                           ", see " + kept.string() + ": choose another folder");
}

// Results of two experiments do not mix, nor those of two datasets.
void prepare_folder(const Options& options, const fs::path& dataset) {
  const nlohmann::json experiment = read_json_file(options.experiment);
  const nlohmann::json flown = {
      {"dataset", dataset.empty() ? "" : fs::canonical(dataset).string()}};
  const fs::path out = options.out;
  std::error_code error;
  fs::create_directories(out, error);
  if (error) throw std::runtime_error(options.out + ": cannot be made: " + error.message());
  if (!fs::exists(out / kExperimentFile) && !fs::is_empty(out))
    throw std::runtime_error(options.out + " is not empty: choose another folder");
  require_same(out / kExperimentFile, experiment, "experiment");
  require_same(out / kDatasetFile, flown, "dataset");
  write_json_file(out / kExperimentFile, experiment);
  write_json_file(out / kDatasetFile, flown);
}

// By the program itself; simulated anew if it was interrupted.
fs::path simulated(const LabExperiment& experiment, const fs::path& out) {
  const fs::path folder = out / "dataset", complete = out / "dataset.complete";
  if (fs::exists(complete)) return folder;
  std::fprintf(stderr, "simulating %s, seed %llu\n", experiment.scenario.c_str(),
               static_cast<unsigned long long>(experiment.scenario_seed));
  ChildProcess simulate = ChildProcess::start_self(
      {"covey", "simulate", experiment.scenario, "--seed", std::to_string(experiment.scenario_seed),
       "--legs", std::to_string(experiment.legs), "--rate", std::to_string(experiment.rate),
       "--force", "--out", folder.string()});
  while (true) {
    const auto end = simulate.ended(std::chrono::milliseconds(200));
    if (stop_requested()) throw std::runtime_error("interrupted while simulating");
    if (!end) continue;
    if (!end->empty()) throw std::runtime_error("covey simulate " + *end);
    break;
  }
  write_json_file(complete, nlohmann::json::object());
  return folder;
}

std::string time_left(const LabProgress& progress) {
  if (progress.cell < 2) return "";
  const auto done = static_cast<double>(progress.cell - 1);
  const double left_s =
      progress.elapsed_s / done * static_cast<double>(progress.cells - progress.cell + 1);
  char text[64];
  std::snprintf(text, sizeof text, ", about %.0f min left", std::ceil(left_s / 60));
  return text;
}

// A line for each flight; on a terminal it also shows how far the flight is.
class LabProgressLine {
 public:
  ~LabProgressLine() {
    if (on_terminal_ && !doing_.empty()) std::fprintf(stderr, "\n");
  }
  LabProgressLine() = default;
  LabProgressLine(const LabProgressLine&) = delete;
  LabProgressLine& operator=(const LabProgressLine&) = delete;

  void show(const LabProgress& progress) {
    const bool is_new = progress.doing != doing_;
    const double now_ms = steady_ms();
    if (!is_new && (!on_terminal_ || now_ms - last_ms_ < 200)) return;
    if (is_new && on_terminal_ && !doing_.empty()) std::fprintf(stderr, "\n");
    last_ms_ = now_ms;
    doing_ = progress.doing;
    std::string line = doing_;
    if (progress.cell > 0) {
      line = std::to_string(progress.cell) + " of " + std::to_string(progress.cells) + ": " + line;
    }
    char flown[64];
    std::snprintf(flown, sizeof flown, ", %.1f of %.1f s", progress.flown_s, progress.total_s);
    std::fprintf(stderr, "%s%s%s%s%s", on_terminal_ ? "\r\033[K" : "", line.c_str(),
                 on_terminal_ ? flown : "", time_left(progress).c_str(), on_terminal_ ? "" : "\n");
    std::fflush(stderr);
  }

 private:
  const bool on_terminal_ = isatty(STDERR_FILENO) != 0;
  std::string doing_;
  double last_ms_ = 0;
};

void run(const Options& options) {
  LabOptions lab;
  lab.experiment = read_experiment(options.experiment);
  lab.experiment_file = options.experiment;
  if (const auto why = why_no_namespaces()) {
    throw std::runtime_error("the laboratory has no network here: " + *why);
  }
  catch_stop_signals();
  lab.dataset = given_dataset(options, lab.experiment);
  if (!lab.dataset.empty()) check_lab(lab);
  prepare_folder(options, lab.dataset);
  lab.out = fs::absolute(options.out);
  if (lab.dataset.empty()) lab.dataset = simulated(lab.experiment, lab.out);
  std::vector<LabOutcome> outcomes;
  {
    LabProgressLine line;
    outcomes = run_lab(lab, [&line](const LabProgress& progress) { line.show(progress); });
  }
  std::printf("%sreport: %s\n", lab_table(outcomes).c_str(), (lab.out / "report.html").c_str());
}

}  // namespace

void add_lab_command(CLI::App& covey) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand(
      "lab", "Experiments: real agents over simulated radio links (needs root on Linux)");
  command->footer(
      "Example: covey lab docs/lab/profiles.json --out runs/profiles\n"
      "         covey lab docs/lab/partition.json --dataset data/castle --out runs/partition\n"
      "Goes on where it was when it is started again. docs/lab.md describes the files.");
  command->add_option("experiment", options->experiment, "What is to be found out")
      ->required()
      ->type_name("EXPERIMENT.json");
  command->add_option("--out", options->out, "Folder for the results")
      ->required()
      ->type_name("DIR");
  command
      ->add_option("--dataset", options->dataset, "Instead of the experiment's dataset or scenario")
      ->type_name("DIR");
  command->callback([options] { run(*options); });
}

}  // namespace covey
