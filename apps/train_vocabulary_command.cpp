// SPDX-License-Identifier: Apache-2.0
#include "apps/train_vocabulary_command.h"

#include <CLI/CLI.hpp>
#include <cinttypes>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/progress.h"
#include "apps/stop_signal.h"
#include "apps/training_images.h"
#include "apps/vocabulary_file.h"
#include "apps/whole_file.h"
#include "frontend/vocabulary_training.h"

namespace covey {
namespace {

struct Options {
  std::vector<std::string> folders;
  std::string out;
  std::size_t images_per_camera = 60;
  TrainingConfig training;
};

TrainingSet describe(const Options& options) {
  TrainingSet all;
  for (const std::string& folder : options.folders) {
    const TrainingSet set = describe_training_images(folder, options.images_per_camera);
    std::fprintf(stderr, "%s: %zu images, %zu descriptors\n", folder.c_str(), set.images,
                 set.descriptors.size());
    all.add(set);
  }
  return all;
}

void train(const Options& options) {
  require_writable(options.out);
  const TrainingSet set = describe(options);
  std::fprintf(stderr, "training %d words, %d times ...\n", options.training.words,
               options.training.restarts);
  catch_stop_signals();
  Progress progress(static_cast<std::size_t>(options.training.restarts), "trainings");
  const TrainedVocabulary trained =
      train_vocabulary(set.descriptors, options.training, [&](int done) {
        if (stop_requested())
          throw std::runtime_error("train-vocabulary: interrupted, nothing is written");
        progress.show(static_cast<std::size_t>(done));
      });
  write_vocabulary(options.out, trained.vocabulary);
  std::printf("%s: %zu words from %zu images, %zu descriptors\n", options.out.c_str(),
              trained.vocabulary.words.size(), set.images, set.descriptors.size());
  std::printf("mean distance to a word %.1f of 256 bits; %s after %d rounds; hash %016" PRIx64 "\n",
              trained.mean_distance_bits, trained.converged ? "settled" : "stopped",
              trained.iterations, vocabulary_hash(trained.vocabulary, PlaceMode::kMajority));
}

}  // namespace

void add_train_vocabulary_command(CLI::App& covey) {
  auto options = std::make_shared<Options>();
  CLI::App* command =
      covey.add_subcommand("train-vocabulary", "Learn the words of places from images");
  command->footer(
      "Example: covey train-vocabulary data/castle images/harbour --out harbour.txt\n"
      "Images are 8- or 16-bit grey: 16-bit (thermal) ones are stretched as in flight.");
  command
      ->add_option("folders", options->folders,
                   "Datasets (uavK/mav0, mav0), or folders of PNG files")
      ->required()
      ->type_name("DIR");
  command->add_option("--out", options->out, "File to write")->required()->type_name("FILE");
  command->add_option("--words", options->training.words, "Number of words")
      ->capture_default_str()
      ->check(CLI::Range(1, 65536));
  command
      ->add_option("--images", options->images_per_camera,
                   "Images of each camera or folder, evenly spread")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000000));
  command->add_option("--restarts", options->training.restarts, "Trainings, the best one is kept")
      ->capture_default_str()
      ->check(CLI::Range(1, 1000));
  command->add_option("--seed", options->training.seed, "Another number, other words")
      ->check(CLI::Range(std::uint64_t{0}, std::uint64_t{1} << 62U))
      ->capture_default_str();
  command->callback([options] { train(*options); });
}

}  // namespace covey
