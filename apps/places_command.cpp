// SPDX-License-Identifier: Apache-2.0
#include "apps/places_command.h"

#include <CLI/CLI.hpp>
#include <cstddef>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/number_range.h"
#include "apps/place_comparison.h"
#include "apps/place_report.h"
#include "apps/progress.h"
#include "apps/stop_signal.h"
#include "apps/vocabulary_file.h"
#include "sim/dataset_writer.h"

namespace covey {
namespace {

struct Options {
  std::vector<std::string> datasets;
  std::string out, vocabulary = "visual", many_words, thermal;
  ComparisonConfig comparison;
  bool force = false;
};

// A line for each drone.
class ProgressByDrone {
 public:
  void operator()(std::size_t done, std::size_t images) {
    if (stop_requested()) throw std::runtime_error("places: interrupted, nothing is written");
    if (done == 1) progress_.emplace(images);
    progress_->show(done);
  }

 private:
  std::optional<Progress> progress_;
};

std::vector<DatasetComparison> compare_all(const Options& options) {
  const std::vector<std::filesystem::path> datasets(options.datasets.begin(),
                                                    options.datasets.end());
  const std::vector<std::string> names = dataset_names(datasets);
  for (const std::filesystem::path& dataset : datasets) (void)drones_to_compare(dataset);
  std::vector<DatasetComparison> comparisons;
  for (const std::filesystem::path& dataset : datasets) {
    comparisons.push_back(compare_descriptors(dataset, options.comparison, ProgressByDrone()));
    DatasetComparison& done = comparisons.back();
    done.dataset = names[comparisons.size() - 1];
    std::fprintf(stderr,
                 "%s: %zu views; of two drones' views %zu pairs show the same place, %zu "
                 "another one\n",
                 dataset.c_str(), done.views, done.same, done.different);
  }
  return comparisons;
}

void require_many_words(const Options& options) {
  constexpr std::size_t kFewest = 1000;
  const std::size_t words = options.comparison.many_words->words.size();
  if (words >= kFewest) return;
  throw std::runtime_error(options.many_words + ": has " + std::to_string(words) +
                           " words; --bag takes " + std::to_string(kFewest) + " or more");
}

void compare(Options options) {
  options.comparison.vocabulary = load_vocabulary(options.vocabulary);
  if (!options.many_words.empty()) {
    options.comparison.many_words = load_vocabulary(options.many_words);
    require_many_words(options);
  }
  options.comparison.thermal =
      thermal_mode_from_name(options.thermal).value_or(options.comparison.thermal);
  catch_stop_signals();
  StagedFolder folder(options.out, options.force ? is_place_report : nullptr);
  const std::vector<DatasetComparison> comparisons = compare_all(options);
  write_place_report(folder.path(), comparisons);
  folder.commit();
  std::fputs(place_table(comparisons).c_str(), stdout);
}

}  // namespace

void add_places_command(CLI::App& covey) {
  auto options = std::make_shared<Options>();
  CLI::App* command =
      covey.add_subcommand("places", "Measure place recognition on datasets with ground truth");
  command->footer(
      "Example: covey places data/castle data/yard --out places\n"
      "Writes places.json, curves.csv and places.svg.");
  command->add_option("datasets", options->datasets, "Datasets of two drones or more")
      ->required()
      ->type_name("DIR");
  command->add_option("--out", options->out, "Folder to write; must not exist yet")
      ->required()
      ->type_name("DIR");
  command
      ->add_option("--vocabulary", options->vocabulary,
                   "Of both VLADs: visual, thermal or a file of covey train-vocabulary")
      ->capture_default_str();
  command->add_option("--bag", options->many_words,
                      "Vocabulary of 1000 words or more: compares a tf-idf bag of words, too");
  command->add_option("--interval", options->comparison.interval_s, "Seconds between views")
      ->capture_default_str()
      ->check(NumberRange(0.01, 1e6));
  command
      ->add_option("--thermal", options->thermal,
                   "Images as they are, or photometrically calibrated (default: thermal cameras' "
                   "images are)")
      ->check(CLI::IsMember({"raw", "calibrated"}));
  command->add_flag("--force", options->force, "Replace a report that is there");
  command->callback([options] { compare(*options); });
}

}  // namespace covey
