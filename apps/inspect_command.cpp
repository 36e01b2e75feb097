// SPDX-License-Identifier: Apache-2.0
#include "apps/inspect_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/inspect_report.h"
#include "apps/progress.h"
#include "apps/stop_signal.h"
#include "sim/dataset_writer.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

struct Options {
  std::string dataset, out, drone, config_file, thermal;
  InspectionConfig inspection;
  bool force = false;
};

DroneFolder chosen_drone(const Options& options) {
  const std::vector<DroneFolder> drones = find_drones(options.dataset);
  if (options.drone.empty()) return drones.front();
  const auto found = std::find_if(drones.begin(), drones.end(), [&](const DroneFolder& drone) {
    return drone.name == options.drone;
  });
  if (found != drones.end()) return *found;
  std::string names;
  for (const DroneFolder& drone : drones) names += (names.empty() ? "" : ", ") + drone.name;
  throw std::runtime_error(options.dataset + ": holds no drone '" + options.drone +
                           "': --agent takes one of " + names);
}

void print_figures(const InspectReport& report, const std::string& out) {
  const Inspection& inspection = report.inspection;
  const auto print = [](const char* images, const InspectedFlight& flight) {
    std::printf("%-11s %6.1f tracks in an image, %5.1f images long\n", images, flight.mean_tracks,
                flight.mean_length);
  };
  print("raw", inspection.raw);
  if (inspection.calibrated) print("calibrated", *inspection.calibrated);
  std::printf("%s/index.html\n", out.c_str());
}

void inspect(Options options) {
  if (!options.config_file.empty()) {
    options.inspection.agent = read_config(options.config_file);
  }
  ThermalMode& mode = options.inspection.agent.thermal.mode;
  mode = thermal_mode_from_name(options.thermal).value_or(mode);
  const DroneFolder drone = chosen_drone(options);
  catch_stop_signals();
  StagedFolder folder(options.out, options.force ? is_inspect_report : nullptr);
  InspectReport report;
  report.dataset = dataset_name(options.dataset);
  report.drone = drone.name;
  report.truth = read_thermal_truth(drone.mav0);
  if (report.truth) options.inspection.field_stamps = field_stamps(*report.truth);
  std::optional<Progress> progress;
  report.inspection =
      inspect_flight(drone, options.inspection, [&](std::size_t done, std::size_t images) {
        if (!progress) progress.emplace(images);
        progress->show(done);
      });
  write_inspect_report(folder.path(), report);
  folder.commit();
  print_figures(report, options.out);
}

}  // namespace

void add_inspect_command(CLI::App& covey) {
  auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand(
      "inspect", "Show what one drone's camera saw: tracks, corners, thermal calibration");
  command->footer(
      "Example: covey inspect data/yard --agent uav1 --out inspected\n"
      "Flies the drone alone, a thermal one on raw and on calibrated images; writes index.html,\n"
      "summary.json and their pictures. Simulated thermal cameras are compared with the truth.");
  command->add_option("dataset", options->dataset, "Folder with one drone or more")
      ->required()
      ->type_name("DIR");
  command->add_option("--out", options->out, "Folder to write; must not exist yet")
      ->required()
      ->type_name("DIR");
  command->add_option("--agent", options->drone, "Which drone (default: the first)");
  command->add_option("--images", options->inspection.pictures, "Moments that are pictured")
      ->capture_default_str()
      ->check(CLI::Range(1, 100));
  command->add_option("--config", options->config_file, "Settings, as covey agent reads them")
      ->type_name("FILE");
  command
      ->add_option("--thermal", options->thermal,
                   "Only images as they are, or both those and calibrated ones, whatever "
                   "sensor.yaml says (default: as in FILE, else both of thermal cameras)")
      ->check(CLI::IsMember({"raw", "calibrated"}));
  command->add_flag("--force", options->force, "Replace a report that is there");
  command->callback([options] { inspect(*options); });
}

}  // namespace covey
