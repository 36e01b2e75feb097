// SPDX-License-Identifier: Apache-2.0
#include "apps/study_command.h"

#include <CLI/CLI.hpp>
#include <cstddef>
#include <cstdio>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/number_range.h"
#include "apps/progress.h"
#include "apps/recorded_flight.h"
#include "apps/stop_signal.h"
#include "apps/study_report.h"
#include "apps/team_study.h"
#include "sim/dataset_writer.h"

namespace covey {
namespace {

struct Options {
  std::string what, out;
  std::vector<int> team_sizes{2, 4, 8, 16, 32};
  int drones = 4;
  StudyConfig study;
  RecordedFiles recordings;
  bool force = false;
};

// A line for each team.
class StudyProgress {
 public:
  void operator()(std::size_t done, std::size_t flights) {
    if (stop_requested()) throw std::runtime_error("study: interrupted, nothing is written");
    if (!progress_) progress_.emplace(flights, "flights");
    progress_->show(done);
  }

 private:
  std::optional<Progress> progress_;
};

void study_scaling(const Options& options) {
  StagedFolder folder(options.out, options.force ? is_scaling : nullptr);
  std::vector<ScalingPoint> points;
  for (const int drones : options.team_sizes) {
    points.push_back(study_team_size(options.study, drones, StudyProgress()));
    std::fprintf(stderr, "%d drones: done\n", drones);
  }
  write_scaling(folder.path(), options.study, points);
  folder.commit();
  std::fputs(scaling_table(points).c_str(), stdout);
}

void study_ablation(const Options& options) {
  StagedFolder folder(options.out, options.force ? is_ablation : nullptr);
  const std::vector<AblationRow> rows = study_parts(options.study, options.drones, StudyProgress());
  write_ablation(folder.path(), options.study, rows);
  folder.commit();
  std::fputs(ablation_table(rows).c_str(), stdout);
}

void read_recordings(Options& options) {
  const std::size_t count = options.recordings.trajectories.size();
  if (count > 0) {
    if (options.what != "ablation")
      throw std::runtime_error("study: --trajectory is for ablation, where one drone flies each");
    if (options.study.scenario != "room")
      throw std::runtime_error("study: --trajectory is flown in a room: add --scenario room");
    if (count < 2) throw std::runtime_error("study: --trajectory needs two or more: a team");
    options.drones = static_cast<int>(count);
  }
  std::vector<RecordedFlight> flights = read_recorded_flights(options.recordings, "study");
  for (RecordedFlight& flight : flights) keep_first_seconds(flight, options.study.duration_s);
  move_into_one_room(flights);
  for (const RecordedFlight& flight : flights) options.study.recorded.push_back(fly_again(flight));
}

void study(Options options) {
  catch_stop_signals();
  read_recordings(options);
  if (options.what == "scaling") {
    study_scaling(options);
  } else {
    study_ablation(options);
  }
}

}  // namespace

void add_study_command(CLI::App& covey) {
  auto options = std::make_shared<Options>();
  CLI::App* command =
      covey.add_subcommand("study", "Measure on simulated features what flying together is worth");
  command->footer(
      "Examples: covey study scaling --out scaling\n"
      "          covey study ablation --scenario mars_yard --seconds 30 --seeds 10 --out ablation\n"
      "          covey study ablation --scenario room --trajectory MH_04.csv V2_01.csv "
      "--seconds 30 --out room\n"
      "Writes scaling.csv and scaling.svg, or ablation.csv, and summary.json.");
  command
      ->add_option("what", options->what,
                   "scaling: against the number of drones; ablation: "
                   "with parts taken away")
      ->required()
      ->check(CLI::IsMember({"scaling", "ablation"}));
  command->add_option("--out", options->out, "Folder to write; must not exist yet")
      ->required()
      ->type_name("DIR");
  command->add_option("--scenario", options->study.scenario, "Who flies where")
      ->capture_default_str();
  command
      ->add_option("--seconds", options->study.duration_s, "Of each flight; 0: the scenario's own")
      ->capture_default_str()
      ->check(NumberRange(0.0, 3600.0));
  command->add_option("--seeds", options->study.seeds, "Runs from seed 1 on")
      ->capture_default_str()
      ->check(CLI::Range(1, 10000));
  command->add_option("--noise", options->study.pixel_sigma, "Pixels of noise in each image")
      ->capture_default_str()
      ->check(NumberRange(0.01, 10.0));
  command
      ->add_option("--mismatch", options->study.corner_mismatch_px,
                   "Pixels between two drones' corners on one landmark")
      ->capture_default_str()
      ->check(NumberRange(0.0, 10.0));
  command->add_option("--sizes", options->team_sizes, "scaling: teams of so many drones")
      ->capture_default_str()
      ->check(CLI::Range(2, 64));
  CLI::Option* drones = command->add_option("--drones", options->drones, "ablation: in the team")
                            ->capture_default_str()
                            ->check(CLI::Range(2, 64));
  command
      ->add_option("--trajectory", options->recordings.trajectories,
                   "ablation of recorded motion, EuRoC csv, one for each drone (room)")
      ->excludes(drones);
  command
      ->add_option("--begin", options->recordings.begins_s,
                   "s into the recording at which a drone begins, one for each --trajectory")
      ->check(NumberRange(0.0, 1e5));
  command->add_flag("--force", options->force, "Replace a study of the same kind");
  command->callback([options] { study(*options); });
}

}  // namespace covey
