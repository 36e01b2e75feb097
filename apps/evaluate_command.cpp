// SPDX-License-Identifier: Apache-2.0
#include "apps/evaluate_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/evaluation.h"
#include "apps/number_range.h"
#include "apps/run_files.h"
#include "apps/trajectory_file.h"

namespace covey {
namespace {

using Json = nlohmann::json;

struct Options {
  std::string truth_file;
  std::string estimate_file;
  std::string covariance_file;
  std::string alignment;  // empty: all of them in the table, posyaw as the chosen one in json
  std::string association = "interpolate";
  double max_difference_s = 0.02;
  double max_gap_s = kLongestTruthGap_s;
  std::vector<double> distances_m;
  std::vector<double> intervals_s{1.0};
  bool json = false;
};

const std::vector<std::pair<std::string, Alignment>> kAlignments = {
    {"none", Alignment::kNone},
    {"posyaw", Alignment::kPosYaw},
    {"se3", Alignment::kSe3},
    {"sim3", Alignment::kSim3},
};

struct Result {
  std::size_t estimate_size = 0;
  std::vector<PosePair> pairs;
  std::map<std::string, AbsoluteError> absolute;
  std::vector<RelativeError> over_distance;
  std::vector<RelativeError> over_time;
  std::optional<Nees> honesty;
};

// Tenths of the path, as Zhang and Scaramuzza's tool chooses them.
std::vector<double> default_distances(double path_m) {
  return {0.1 * path_m, 0.2 * path_m, 0.3 * path_m, 0.4 * path_m, 0.5 * path_m};
}

std::vector<StampedCovariance> covariances_of(const Options& options) {
  if (!options.covariance_file.empty()) return read_covariances(options.covariance_file);
  const std::filesystem::path beside =
      std::filesystem::path(options.estimate_file).replace_filename(kCovarianceFile);
  if (!std::filesystem::exists(beside)) return {};
  return read_covariances(beside);
}

std::vector<PosePair> associated(const Options& options, const StampedPoses& estimate,
                                 const StampedPoses& truth) {
  AssociationOptions association;
  association.method =
      options.association == "nearest" ? Association::kNearest : Association::kInterpolate;
  association.max_difference_s = options.max_difference_s;
  association.max_gap_s = options.max_gap_s;
  try {
    return associate(estimate, truth, association);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(options.estimate_file + " against " + options.truth_file + ": " +
                             error.what());
  }
}

Result evaluate(const Options& options) {
  const StampedPoses estimate = read_trajectory(options.estimate_file);
  Result result;
  result.estimate_size = estimate.size();
  result.pairs = associated(options, estimate, read_trajectory(options.truth_file));
  for (const auto& [name, alignment] : kAlignments) {
    result.absolute[name] = absolute_error(result.pairs, alignment);
  }
  const std::vector<double> distances_m = options.distances_m.empty()
                                              ? default_distances(path_length_m(result.pairs))
                                              : options.distances_m;
  for (const double distance_m : distances_m) {
    const auto error = relative_error_over_distance(result.pairs, distance_m);
    if (error) result.over_distance.push_back(*error);
  }
  for (const double interval_s : options.intervals_s) {
    const auto error = relative_error_over_time(result.pairs, interval_s);
    if (error) result.over_time.push_back(*error);
  }
  result.honesty = nees(result.pairs, covariances_of(options));
  if (!result.honesty && !options.covariance_file.empty()) {
    throw std::runtime_error(options.covariance_file + ": no covariance at the estimate's stamps");
  }
  return result;
}

double duration_s(const Result& result) {
  return seconds_between(result.pairs.front().stamp_ns, result.pairs.back().stamp_ns);
}

Json to_json(const ErrorStatistics& error) {
  return {{"rmse", error.rmse}, {"mean", error.mean}, {"std", error.std}, {"max", error.max}};
}

Json to_json(const std::vector<RelativeError>& errors, const char* length_key) {
  Json list = Json::array();
  for (const RelativeError& error : errors) {
    list.push_back({{length_key, error.length},
                    {"stretches", error.stretches},
                    {"position_m", to_json(error.position_m)},
                    {"rotation_deg", to_json(error.rotation_deg)}});
  }
  return list;
}

// The chosen alignment's figures stand at the top, everything else below.
void print_json(const Result& result, const Options& options) {
  const std::string chosen = options.alignment.empty() ? "posyaw" : options.alignment;
  Json json = to_json(result.absolute.at(chosen).position_m);
  json["align"] = chosen;
  json["scale"] = result.absolute.at(chosen).scale;
  json["association"] = options.association;
  json["poses"] = result.estimate_size;
  json["matched"] = result.pairs.size();
  json["distance_m"] = path_length_m(result.pairs);
  json["duration_s"] = duration_s(result);
  for (const auto& [name, error] : result.absolute) {
    json["ate_m"][name] = to_json(error.position_m);
    json["rotation_deg"][name] = to_json(error.rotation_deg);
  }
  json["ate_m"]["sim3"]["scale"] = result.absolute.at("sim3").scale;
  json["rpe_distance"] = to_json(result.over_distance, "distance_m");
  json["rpe_time"] = to_json(result.over_time, "interval_s");
  json["nees"] = nullptr;
  if (result.honesty) {
    json["nees"] = {{"position", result.honesty->position},
                    {"orientation", result.honesty->orientation},
                    {"samples", result.honesty->samples}};
  }
  std::printf("%s\n", json.dump(2).c_str());
}

void print_relative(const std::vector<RelativeError>& errors, const char* unit) {
  for (const RelativeError& error : errors) {
    std::printf("  %8.2f %-2s %12.4f %9.4f %9.4f %15.3f %10d\n", error.length, unit,
                error.position_m.rmse, error.position_m.mean, error.position_m.std,
                error.rotation_deg.rmse, error.stretches);
  }
}

void print_table(const Result& result, const Options& options) {
  std::printf("%zu of %zu poses matched (%s), %.1f m in %.1f s\n\n", result.pairs.size(),
              result.estimate_size, options.association.c_str(), path_length_m(result.pairs),
              duration_s(result));
  std::printf(
      "  aligned      ATE rmse m    mean m     std m     max m  rotation rmse deg   scale\n");
  for (const auto& [name, alignment] : kAlignments) {
    if (!options.alignment.empty() && name != options.alignment) continue;
    const AbsoluteError& error = result.absolute.at(name);
    std::printf("  %-10s %12.6f %9.6f %9.6f %9.6f %18.3f %7.4f\n", name.c_str(),
                error.position_m.rmse, error.position_m.mean, error.position_m.std,
                error.position_m.max, error.rotation_deg.rmse, error.scale);
  }
  if (!result.over_distance.empty() || !result.over_time.empty()) {
    std::printf("\n  over          RPE rmse m    mean m     std m    rotation deg  stretches\n");
    print_relative(result.over_distance, "m");
    print_relative(result.over_time, "s");
  }
  if (result.honesty) {
    std::printf("\n  NEES (3 is honest): position %.2f, orientation %.2f over %d poses\n",
                result.honesty->position, result.honesty->orientation, result.honesty->samples);
  }
}

void add_options(CLI::App& command, Options& options) {
  command.add_option("--groundtruth", options.truth_file, "True trajectory: TUM or EuRoC csv")
      ->required()
      ->type_name("GT");
  command.add_option("--estimate", options.estimate_file, "Estimated trajectory: TUM or EuRoC csv")
      ->required()
      ->type_name("EST");
  command
      .add_option("--align", options.alignment,
                  "Fit of the whole estimate to the truth; default: all in the table, posyaw first "
                  "in json")
      ->check(CLI::IsMember({"none", "posyaw", "se3", "sim3"}));
  command
      .add_option("--association", options.association,
                  "Truth at the estimate's stamps, or the nearest stamps one to one")
      ->check(CLI::IsMember({"interpolate", "nearest"}))
      ->capture_default_str();
  command
      .add_option("--max-difference", options.max_difference_s,
                  "Seconds between stamps that match, for nearest")
      ->check(NumberRange(1e-9, 1e6))
      ->capture_default_str();
  command
      .add_option("--max-gap", options.max_gap_s,
                  "Seconds between two true poses between which to interpolate, at most")
      ->check(NumberRange(1e-9, 1e6))
      ->capture_default_str();
  command
      .add_option("--covariance", options.covariance_file,
                  "Covariances for NEES; default: trajectory_covariance.csv beside EST, if any")
      ->type_name("CSV");
  command
      .add_option("--rpe-distance", options.distances_m,
                  "Metres of the stretches for relative errors; default: tenths of the path")
      ->check(NumberRange(1e-3, 1e6));
  command
      .add_option("--rpe-interval", options.intervals_s,
                  "Seconds of the stretches for relative errors")
      ->check(NumberRange(1e-3, 1e6))
      ->capture_default_str();
  command.add_flag("--json", options.json, "Print every figure as json");
}

}  // namespace

void add_evaluate_command(CLI::App& covey) {
  CLI::App* command =
      covey.add_subcommand("evaluate", "Errors of an estimated trajectory against the true one");
  command->footer(
      "Example: covey evaluate --groundtruth uav0/mav0/state_groundtruth_estimate0/data.csv "
      "--estimate run/uav0/trajectory.tum --align se3");
  const auto options = std::make_shared<Options>();
  add_options(*command, *options);
  command->callback([options] {
    const Result result = evaluate(*options);
    options->json ? print_json(result, *options) : print_table(result, *options);
  });
}

}  // namespace covey
