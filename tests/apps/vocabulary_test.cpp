// SPDX-License-Identifier: Apache-2.0
//
// `covey train-vocabulary` and the files it writes.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <iterator>
#include <opencv2/imgproc.hpp>
#include <string>

#include "apps/png_file.h"
#include "apps/training_images.h"
#include "apps/vocabulary_file.h"
#include "frontend/vocabulary_thermal.h"
#include "frontend/vocabulary_visual.h"
#include "tests/apps/command_run.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string train(const std::string& arguments) {
  return complaint_of("train-vocabulary " + arguments);
}

std::string complaint_of_loading(const std::string& name_or_path) {
  try {
    (void)load_vocabulary(name_or_path);
    return "";
  } catch (const std::runtime_error& error) {
    return error.what();
  }
}

// Rectangles of any grey: many corners.
cv::Mat patchwork(int seed) {
  cv::RNG random(static_cast<std::uint64_t>(seed) + 1);
  cv::Mat image(180, 240, CV_8UC1, cv::Scalar(100));
  for (int i = 0; i < 150; ++i) {
    const cv::Rect area(random.uniform(0, 230), random.uniform(0, 170), random.uniform(4, 40),
                        random.uniform(4, 40));
    cv::rectangle(image, area, cv::Scalar(random.uniform(0, 256)), cv::FILLED);
  }
  return image;
}

fs::path write_images(const TemporaryFolder& folder, int count) {
  const fs::path images = folder.path() / "images";
  fs::create_directory(images);
  for (int i = 0; i < count; ++i) {
    write_png((images / (std::to_string(i) + ".png")).string(), patchwork(i));
  }
  return images;
}

std::size_t entries(const fs::path& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

TEST(TrainVocabulary, WordsOfAFolderOfImagesAreTheSameForTheSameSeed) {
  const TemporaryFolder folder;
  const std::string images = write_images(folder, 4).string();
  const auto words = [&](const std::string& name, const std::string& options) {
    const std::string file = (folder.path() / name).string();
    EXPECT_EQ(train(images + " --words 16 --out " + file + " " + options), "");
    return load_vocabulary(file).words;
  };
  const auto first = words("first.txt", "");
  EXPECT_EQ(first.size(), 16u);
  EXPECT_EQ(first, words("again.txt", "--seed 1"));
  EXPECT_NE(first, words("other.txt", "--seed 2"));
  EXPECT_EQ(entries(folder.path()), 4u) << "nothing half-written is left";
}

TEST(TrainVocabulary, ReplacesAnOlderFileOnlyByAWholeOne) {
  const TemporaryFolder folder;
  const fs::path out = folder.write("words.txt", to_text(visual_vocabulary()));
  fs::create_directory(folder.path() / "empty");
  EXPECT_NE(train((folder.path() / "empty").string() + " --out " + out.string()), "");
  EXPECT_EQ(load_vocabulary(out.string()).words.size(), 64u);
  const std::string images = write_images(folder, 2).string();
  EXPECT_EQ(train(images + " --words 8 --out " + out.string()), "");
  EXPECT_EQ(load_vocabulary(out.string()).words.size(), 8u);
}

TEST(TrainVocabulary, SaysInOneLineWhatIsWrong) {
  const TemporaryFolder folder;
  const std::string here = folder.path().string(), out = " --out " + here + "/words.txt";
  EXPECT_THAT(train(here + "/nowhere" + out), HasSubstr("is not a folder: is the path right?"));
  EXPECT_THAT(train(here + out), HasSubstr("holds no drone"));
  const std::string images = write_images(folder, 1).string();
  EXPECT_THAT(train(images + " --out " + here + "/nowhere/words.txt"), HasSubstr("not a folder"));
  EXPECT_THAT(train(images + " --out " + here), HasSubstr("is a folder"));
  EXPECT_THAT(train(images + " --words 5000" + out), HasSubstr("are too few for 5000 words"));
  folder.write("images/a.png", "not a picture");
  EXPECT_THAT(train(images + out), HasSubstr("a.png"));
  EXPECT_FALSE(fs::exists(folder.path() / "words.txt"));
}

TEST(TrainingImages, AreSpreadOverTheFolderAndMayHaveSixteenBits) {
  const TemporaryFolder folder;
  const fs::path images = write_images(folder, 6);
  EXPECT_EQ(describe_training_images(images, 100).images, 6u);
  EXPECT_EQ(describe_training_images(images, 3).images, 3u);
  const std::size_t corners = describe_training_images(images, 1).descriptors.size();
  EXPECT_GT(corners, 20u);

  cv::Mat raw;
  patchwork(0).convertTo(raw, CV_16U, 4, 8000);
  write_png((images / "0.png").string(), raw);
  const std::size_t raw_corners = describe_training_images(images, 1).descriptors.size();
  EXPECT_NEAR(static_cast<double>(raw_corners), static_cast<double>(corners), 5);
}

TEST(LoadVocabulary, KnowsTheShippedOnesAndFiles) {
  EXPECT_EQ(load_vocabulary("visual").words, visual_vocabulary().words);
  EXPECT_EQ(load_vocabulary("thermal").words, thermal_vocabulary().words);
  EXPECT_NE(thermal_vocabulary().words, visual_vocabulary().words);
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "words.txt").string();
  write_vocabulary(file, {{visual_vocabulary().words[3], visual_vocabulary().words[5]}});
  const Vocabulary loaded = load_vocabulary(file);
  ASSERT_EQ(loaded.words.size(), 2u);
  EXPECT_EQ(loaded.words[1], visual_vocabulary().words[5]);
}

std::string complaint_of_flying_with(const AgentConfig& config) {
  try {
    (void)vocabulary_of(config, false);
    return "";
  } catch (const std::runtime_error& error) {
    return error.what();
  }
}

TEST(VocabularyOf, SuitsACameraThatIsNamedThermalOrToBeCalibrated) {
  AgentConfig config;
  EXPECT_EQ(vocabulary_of(config, false).words, visual_vocabulary().words);
  EXPECT_EQ(vocabulary_of(config, true).words, thermal_vocabulary().words);
  config.thermal.mode = ThermalMode::kCalibrated;
  EXPECT_EQ(vocabulary_of(config, false).words, thermal_vocabulary().words);
  config.thermal.mode = ThermalMode::kRaw;
  EXPECT_EQ(vocabulary_of(config, false).words, visual_vocabulary().words);
  EXPECT_EQ(vocabulary_of(config, true).words, thermal_vocabulary().words);
}

TEST(VocabularyOf, RefusesMoreWordsThanAQuestionHasRoomForWhereTheyAreSent) {
  const TemporaryFolder folder;
  Vocabulary vocabulary;
  vocabulary.words.assign(128, visual_vocabulary().words[0]);
  AgentConfig config;
  config.agent.vocabulary = (folder.path() / "words.txt").string();
  config.collaboration.exchange = ExchangeMode::kPaper;
  write_vocabulary(config.agent.vocabulary, vocabulary);
  EXPECT_EQ(complaint_of_flying_with(config), "");

  vocabulary.words.push_back(visual_vocabulary().words[1]);
  write_vocabulary(config.agent.vocabulary, vocabulary);
  const std::string named = "agent.vocabulary '" + config.agent.vocabulary + "': 129 words";
  EXPECT_THAT(complaint_of_flying_with(config), HasSubstr(named));
  config.collaboration.exchange = ExchangeMode::kCompact;
  for (const PlaceMode mode : {PlaceMode::kPaper, PlaceMode::kMajority}) {
    config.collaboration.place_mode = mode;
    EXPECT_THAT(complaint_of_flying_with(config), HasSubstr(named));
  }
  config.collaboration.place_mode = PlaceMode::kCompact;
  EXPECT_EQ(complaint_of_flying_with(config), "") << "corners go along, not words";
  config.collaboration.exchange = ExchangeMode::kNaive;
  EXPECT_EQ(complaint_of_flying_with(config), "") << "nothing is asked";
}

TEST(LoadVocabulary, NamesTheFileThatIsWrong) {
  const TemporaryFolder folder;
  EXPECT_THAT(complaint_of_loading("infrared"), HasSubstr("'infrared': cannot be read"));
  EXPECT_THAT(complaint_of_loading(folder.path().string()), HasSubstr("cannot be read"));
  const std::string file = folder.write("words.txt", "0123\n").string();
  EXPECT_THAT(complaint_of_loading(file), HasSubstr(file + ": vocabulary, line 1: 4 characters"));
}

}  // namespace
}  // namespace covey
