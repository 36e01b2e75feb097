// SPDX-License-Identifier: Apache-2.0
//
// `covey train-vocabulary` and `covey places`, run as programs on the simulated flight.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/json_file.h"
#include "apps/place_survey.h"
#include "apps/vocabulary_file.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(PlacesProgram, TrainsOnAFlightAndMeasuresWithTheWords) {
  const TemporaryFolder folder;
  const std::string words = (folder.path() / "words.txt").string();
  CoveyProcess training({"train-vocabulary", COVEY_TEST_FLIGHT, "--out", words, "--words", "32",
                         "--images", "4", "--restarts", "1"});
  ASSERT_EQ(training.finish(), 0) << training.output();
  EXPECT_THAT(training.output(), HasSubstr("32 words from 8 images"));
  EXPECT_THAT(training.output(), HasSubstr("hash "));
  EXPECT_EQ(load_vocabulary(words).words.size(), 32u);

  const std::string out = (folder.path() / "places").string();
  CoveyProcess places({"places", COVEY_TEST_FLIGHT, "--out", out, "--vocabulary", words});
  ASSERT_EQ(places.finish(), 0) << places.output();
  const nlohmann::json flight = read_json_file(out + "/places.json")["flight"];
  EXPECT_GE(flight["views"], 8);
  EXPECT_EQ(flight["descriptors"]["paper"]["mean_bytes"], 32 * 32);
  EXPECT_GT(flight["descriptors"]["compact"]["average_precision"], 0.5);
}

TEST(PlacesProgram, ATrainingShowsHowFarItIsAndCanBeStopped) {
  const TemporaryFolder folder;
  CoveyProcess training({"train-vocabulary", COVEY_TEST_FLIGHT, "--out",
                         (folder.path() / "words.txt").string(), "--restarts", "1000"});
  ASSERT_TRUE(training.wait_for("/1000 trainings"));
  training.send(SIGINT);
  EXPECT_EQ(training.finish(), 1);
  EXPECT_THAT(training.output(), HasSubstr("train-vocabulary: interrupted, nothing is written"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(SurveyFlight, LooksAtImagesAsTheyAreFlownOrAsAskedFor) {
  const DroneFolder drone = find_drones(COVEY_TEST_FLIGHT).front();
  const auto features = [&](ThermalMode thermal) {
    return survey_flight(drone, 1.0, thermal).front().features;
  };
  const auto raw = features(ThermalMode::kRaw);
  EXPECT_EQ(features(ThermalMode::kAuto), raw) << "the camera is a visual one";
  EXPECT_NE(features(ThermalMode::kCalibrated), raw) << "other contrast, other corners";
}

TEST(Targets, AreLookedAtBeforeTheWork) {
  const TemporaryFolder folder;
  const std::string file = folder.write("file", "mine").string();
  for (const std::vector<std::string>& command : std::vector<std::vector<std::string>>{
           {"places", "/nowhere", "--out", file + "/sub"},
           {"study", "scaling", "--scenario", "nowhere", "--out", file + "/sub"},
           {"tables", "/nowhere", "--commit", "c", "--machine", "m", "--command", "n", "--out",
            file + "/sub"},
           {"simulate", "room", "--trajectory", "/nowhere", "--out", file + "/sub"},
           {"train-vocabulary", "/nowhere", "--out", file + "/sub"}}) {
    CoveyProcess covey(command);
    EXPECT_EQ(covey.finish(), 1) << command.front();
    EXPECT_THAT(covey.output(), StartsWith("covey: " + file + "/sub")) << command.front();
  }
  EXPECT_EQ(file_content(file), "mine");
  CoveyProcess nameless({"simulate", "room", "--trajectory", "/nowhere", "--out", ""});
  EXPECT_EQ(nameless.finish(), 1);
  EXPECT_THAT(nameless.output(), HasSubstr("--out names no folder"));
}

// The test flight under the same name in another folder.
std::string flight_below(const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  std::filesystem::create_directory_symlink(COVEY_TEST_FLIGHT, folder / "flight");
  return (folder / "flight").string();
}

TEST(PlacesProgram, DatasetsOfOneNameAreToldApart) {
  const TemporaryFolder folder;
  const std::string out = (folder.path() / "out").string();
  const std::string first = flight_below(folder.path() / "a"),
                    second = flight_below(folder.path() / "b");
  CoveyProcess places({"places", first, second, "--interval", "1", "--out", out});
  ASSERT_EQ(places.finish(), 0) << places.output();
  const nlohmann::json json = read_json_file(out + "/places.json");
  EXPECT_EQ(json.size(), 2u);
  EXPECT_EQ(json.at("a/flight"), json.at("b/flight"));
  EXPECT_THAT(file_content(out + "/curves.csv"), HasSubstr("\nb/flight,compact,"));

  CoveyProcess twice({"places", first, first + "/", "--out", out + "2"});
  EXPECT_EQ(twice.finish(), 1);
  EXPECT_THAT(twice.output(), HasSubstr("flight/: is named twice"));
  EXPECT_FALSE(std::filesystem::exists(out + "2"));
}

TEST(PlacesProgram, SaysInOneLineWhatIsWrong) {
  const TemporaryFolder folder;
  const std::string here = folder.path().string();
  CoveyProcess places({"places", here, "--out", here + "/out"});
  EXPECT_EQ(places.finish(), 1);
  EXPECT_THAT(places.output(), HasSubstr("holds no drone"));
  EXPECT_FALSE(std::filesystem::exists(here + "/out")) << "nothing is left of a folder it made";
  CoveyProcess unknown({"places", COVEY_TEST_FLIGHT, "--out", here, "--vocabulary", "infrared"});
  EXPECT_EQ(unknown.finish(), 1);
  EXPECT_THAT(unknown.output(), HasSubstr("'infrared': cannot be read"));
}

TEST(PlacesProgram, SaysBeforeTheWorkWhatIsWrong) {
  const TemporaryFolder folder;
  const std::string out = (folder.path() / "out").string();
  CoveyProcess places({"places", COVEY_TEST_FLIGHT, "/nowhere", "--out", out});
  EXPECT_EQ(places.finish(), 1);
  EXPECT_EQ(places.output(), "covey: /nowhere: is not a folder: is the path right?\n");
  CoveyProcess bag({"places", COVEY_TEST_FLIGHT, "--bag", "visual", "--out", out});
  EXPECT_EQ(bag.finish(), 1);
  EXPECT_EQ(bag.output(), "covey: visual: has 64 words; --bag takes 1000 or more\n");
  CoveyProcess seed({"train-vocabulary", COVEY_TEST_FLIGHT, "--seed", "-1", "--out", out});
  EXPECT_EQ(seed.finish(), 2);
  EXPECT_THAT(seed.output(), HasSubstr("--seed"));
}

TEST(PlacesProgram, WritesIntoNoFolderThatHoldsSomethingElse) {
  const TemporaryFolder folder;
  const std::string mine = folder.write("out/curves.csv", "mine").string();
  const std::string out = (folder.path() / "out").string();
  for (const std::vector<std::string>& force : {std::vector<std::string>{}, {"--force"}}) {
    std::vector<std::string> command = {"places", COVEY_TEST_FLIGHT, "--out", out};
    command.insert(command.end(), force.begin(), force.end());
    CoveyProcess places(command);
    EXPECT_EQ(places.finish(), 1);
    EXPECT_THAT(places.output(), HasSubstr("choose another --out"));
  }
  EXPECT_EQ(file_content(mine), "mine");
}

TEST(PlacesProgram, IsStoppedAtAnyImageAndLeavesNothing) {
  const TemporaryFolder folder;
  const std::string out = (folder.path() / "out").string();
  CoveyProcess places(
      {"places", COVEY_TEST_FLIGHT, flight_below(folder.path() / "again"), "--out", out});
  ASSERT_TRUE(places.wait_for("images"));
  places.send(SIGINT);
  EXPECT_EQ(places.finish(), 1);
  EXPECT_THAT(places.output(), HasSubstr("places: interrupted, nothing is written"));
  EXPECT_FALSE(std::filesystem::exists(out));
}

}  // namespace
}  // namespace covey
