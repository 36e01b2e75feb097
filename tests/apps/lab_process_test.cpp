// SPDX-License-Identifier: Apache-2.0
//
// The laboratory itself, with two drones on a small simulated flight. Skipped, saying why, where
// nobody may make network namespaces.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

#include "apps/drone_network.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

class Lab : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why = why_no_namespaces()) GTEST_SKIP() << *why;
  }

  [[nodiscard]] std::vector<std::string> command(const json& experiment) const {
    const fs::path file = folder_.write("experiment.json", experiment.dump());
    return {"lab", file.string(), "--dataset", COVEY_TEST_FLIGHT, "--out", out().string()};
  }
  [[nodiscard]] fs::path out() const { return folder_.path() / "out"; }
  [[nodiscard]] json summary() const { return json::parse(file_content(out() / "summary.json")); }

  // Of this test's flights.
  [[nodiscard]] bool agents_run() const { return find_process(out().string()).has_value(); }

  TemporaryFolder folder_;
};

json lossy_flight() {
  return {{"name", "test"}, {"seconds", 2}, {"loss", 0.1}, {"delay_ms", 5}, {"rate_mbit", 6}};
}

TEST_F(Lab, FliesRealAgentsOverALossyLinkAndNothingTwice) {
  CoveyProcess covey(command(lossy_flight()));
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_THAT(covey.output(), AllOf(HasSubstr("alone"), HasSubstr("1 of 1"), HasSubstr("wire")));
  const json figures = summary()["cells"][0]["figures"];
  EXPECT_GT(figures["met_after_s"], 0);
  EXPECT_GT(figures["frames"], 0);
  EXPECT_NEAR(figures["lost_share"], 0.1, 0.09);
  EXPECT_GT(figures["wire_bytes_per_s"], 0);
  EXPECT_EQ(figures["shared_memory_left"], 0);
  EXPECT_EQ(figures["ended_early"], 0);
  EXPECT_TRUE(fs::exists(out() / "cells.csv"));
  EXPECT_TRUE(fs::exists(out() / "report.html"));

  CoveyProcess again(command(lossy_flight()));
  ASSERT_EQ(again.finish(), 0) << again.output();
  EXPECT_THAT(again.output(), Not(HasSubstr("1 of")));
  EXPECT_EQ(summary()["cells"][0]["figures"], figures);

  json other = lossy_flight();
  other["loss"] = 0.2;
  CoveyProcess refused(command(other));
  EXPECT_EQ(refused.finish(), 1);
  EXPECT_THAT(refused.output(), HasSubstr("holds the results of another experiment"));

  const fs::path twin = folder_.path() / "twin";
  fs::create_directories(twin);
  fs::create_directory_symlink(fs::path(COVEY_TEST_FLIGHT) / "uav0", twin / "scout");
  fs::create_directory_symlink(fs::path(COVEY_TEST_FLIGHT) / "uav1", twin / "miner");
  std::vector<std::string> elsewhere = command(lossy_flight());
  elsewhere[3] = twin.string();
  CoveyProcess mixed(elsewhere);
  EXPECT_EQ(mixed.finish(), 1);
  EXPECT_THAT(mixed.output(), HasSubstr("holds the results of another dataset"));
  EXPECT_EQ(std::count(mixed.output().begin(), mixed.output().end(), '\n'), 1);
}

TEST_F(Lab, DronesThatOnlyMeetMayShareARecording) {
  CoveyProcess covey(command({{"name", "test"},
                              {"fly", false},
                              {"settle_s", 0.1},
                              {"hold_s", 0.5},
                              {"drones", 3},
                              {"delay_ms", 5}}));
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  const json figures = summary()["cells"][0]["figures"];
  EXPECT_GT(figures["met_after_s"], 0);
  EXPECT_GT(figures["meeting_bytes"], 0);
  EXPECT_TRUE(figures["ate_m"].is_null());
}

TEST_F(Lab, AgentsThatAreKilledComeBackIntoTheFlightAndTheOthersGoOn) {
  // Slow enough for a kill and a return: 7.5 s of the clock.
  CoveyProcess covey(command({{"name", "test"},
                              {"pace", 0.4},
                              {"delay_ms", 5},
                              {"kills", {{"count", 1}, {"again_after_s", 0.1}}}}));
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  const json figures = summary()["cells"][0]["figures"];
  EXPECT_EQ(figures["kills"], 1);
  EXPECT_EQ(figures["met_again"], 1);
  EXPECT_EQ(figures["ended_early"], 0);
  EXPECT_EQ(figures["shared_memory_left"], 0);

  int lives = 0;
  for (const char* drone : {"uav0", "uav1"}) {
    const fs::path run = out() / "cells" / summary()["cells"][0]["name"].get<std::string>() / drone;
    const fs::path again = run / "again1" / "agent_summary.json";
    if (!fs::exists(again)) continue;
    ++lives;
    // It sees what comes from then on, not what it has missed.
    const json second = json::parse(file_content(again));
    EXPECT_GT(second["frames"], 0);
    EXPECT_LT(second["frames"].get<int>() + second["frames_dropped"].get<int>(),
              COVEY_TEST_FLIGHT_FRAMES);
  }
  EXPECT_EQ(lives, 1);
}

TEST_F(Lab, OneThatIsInterruptedLeavesNobodyBehindAndGoesOnLater) {
  CoveyProcess covey(command({{"name", "test"}, {"pace", 0.05}, {"delay_ms", 5}}));
  ASSERT_TRUE(covey.wait_for("1 of 1")) << covey.output();
  covey.send(SIGINT);
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), HasSubstr("interrupted; the same command goes on"));
  EXPECT_FALSE(agents_run());
}

TEST_F(Lab, OneThatIsKilledTakesItsAgentsWithItAndTheirNamespaces) {
  CoveyProcess covey(command({{"name", "test"}, {"pace", 0.05}, {"delay_ms", 5}}));
  ASSERT_TRUE(covey.wait_for("1 of 1")) << covey.output();
  covey.send(SIGKILL);
  EXPECT_EQ(covey.finish(), -SIGKILL);
  // The kernel kills them; it needs a moment. Who is dead holds no namespace.
  for (int i = 0; i < 500 && agents_run(); ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_FALSE(agents_run());
}

TEST_F(Lab, AMistakeIsOneLineThatNamesTheKey) {
  const json partition{{"from_s", 0}, {"until_s", 1}, {"apart", {"uav7"}}};
  const json too_late{{"from_s", 60}, {"until_s", 70}, {"apart", {"uav0"}}};
  for (const auto& [experiment, complaint] : std::vector<std::pair<json, std::string>>{
           {{{"name", "n"}, {"lost", 1}}, "unknown key 'lost'"},
           {{{"name", "n"}, {"drones", 5}}, "'drones' is 5, but a team has 2 to 32"},
           {{{"name", "n"}, {"partitions", {partition}}}, "'partitions.apart' names uav7"},
           {{{"name", "n"}, {"partitions", {too_late}}}, "'partitions.from_s' is 60 s, but"}}) {
    CoveyProcess covey(command(experiment));
    EXPECT_EQ(covey.finish(), 1);
    EXPECT_THAT(covey.output(), HasSubstr(complaint));
    EXPECT_EQ(std::count(covey.output().begin(), covey.output().end(), '\n'), 1);
    EXPECT_FALSE(fs::exists(out()));
  }
}

}  // namespace
}  // namespace covey
