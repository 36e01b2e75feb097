// SPDX-License-Identifier: Apache-2.0
//
// Drones that fly each by itself, as in containers, and who sums up for them.
#include "apps/collected_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <thread>

#include "apps/agent.h"
#include "apps/free_domain.h"
#include "apps/json_file.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;

class CollectedFlight : public testing::Test {
 protected:
  [[nodiscard]] fs::path run() const { return folder_.path() / "run"; }

  [[nodiscard]] std::string write_config() const {
    const json settings = {{"agent", {{"pace", "rate"}, {"real_time_factor", 2}}},
                           {"link", {{"domain", domain_.id()}}}};
    return folder_.write("agent.json", settings.dump()).string();
  }

  std::vector<std::string> agent(const std::string& name) {
    return {"agent",
            "--config",
            config_,
            "--name",
            name,
            "--team-of",
            "2",
            "--dataset",
            std::string(COVEY_TEST_FLIGHT) + "/" + name + "/mav0",
            "--out",
            (run() / name).string()};
  }

  int report(const std::string& silence_s) {
    CoveyProcess covey({"report", run().string(), "--dataset", COVEY_TEST_FLIGHT, "--config",
                        config_, "--wait", silence_s});
    const int code = covey.finish();
    output_ = covey.output();
    return code;
  }

  TemporaryFolder folder_;
  FreeDomain domain_;
  const std::string config_ = write_config();  // once: whoever flies may be reading it
  std::string output_;
};

TEST_F(CollectedFlight, TwoDronesThatFlewByThemselvesGetOneReport) {
  CoveyProcess uav0(agent("uav0")), uav1(agent("uav1"));
  ASSERT_EQ(report("60"), 0) << output_;
  EXPECT_EQ(uav0.finish(), 0) << uav0.output();
  EXPECT_EQ(uav1.finish(), 0) << uav1.output();
  const RunSummary summary = read_run_summary(run() / "summary.json");
  ASSERT_EQ(summary.agents.size(), 2u);
  std::size_t peers = 0;
  for (const auto& [name, agent] : summary.agents) {
    EXPECT_EQ(agent.frames + agent.frames_dropped, COVEY_TEST_FLIGHT_FRAMES);
    EXPECT_TRUE(agent.accuracy);
    EXPECT_FALSE(agent.incomplete);
    const json status = read_json_file(run() / name / kAgentStatusFile);
    EXPECT_GT(status.at("frames"), 0);
    peers += status.at("peers").size();
    EXPECT_TRUE(status.at("dropped_by_load").is_object());
  }
  EXPECT_GE(peers, 1u) << "who was done first heard the other until then";
  EXPECT_TRUE(fs::exists(run() / "report.html"));
}

TEST_F(CollectedFlight, ANamesakeIsNoPeerAndBothSaySo) {
  const auto uav0_to = [this](const std::string& folder) {
    std::vector<std::string> arguments = agent("uav0");
    arguments.back() = (run() / folder).string();
    return arguments;
  };
  CoveyProcess one(uav0_to("one")), other(uav0_to("other"));
  const std::string words = "another drone bears this drone's name: give each drone";
  EXPECT_TRUE(one.wait_for(words)) << one.output();
  EXPECT_TRUE(other.wait_for(words)) << other.output();
  const json status = read_json_file(run() / "one" / kAgentStatusFile);
  EXPECT_FALSE(status.at("rejected_by_link").empty()) << status;
  one.send(SIGTERM);
  other.send(SIGTERM);
  EXPECT_EQ(one.finish(), 1);
  EXPECT_EQ(other.finish(), 1);
}

TEST_F(CollectedFlight, OneThatFellSilentIsNamedInTheReport) {
  fs::create_directories(run() / "uav1");
  ASSERT_EQ(report("0.1"), 0) << output_;
  const RunSummary summary = read_run_summary(run() / "summary.json");
  EXPECT_EQ(summary.agents.at("uav1").incomplete, "ended without a summary");
}

TEST_F(CollectedFlight, WhoWaitsForOthersIsHealthy) {
  CoveyProcess uav0(agent("uav0"));
  const fs::path status = run() / "uav0" / kAgentStatusFile;
  const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  bool waits = false;
  while (!waits && std::chrono::steady_clock::now() < deadline) {
    waits = fs::exists(status) && read_json_file(status).contains("peers");
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  EXPECT_TRUE(waits) << "nothing was written while it waited";
  uav0.send(SIGTERM);
  EXPECT_EQ(uav0.finish(), 1);
  ASSERT_EQ(report("0.3"), 0) << output_;
  EXPECT_EQ(read_run_summary(run() / "summary.json").agents.at("uav0").incomplete, "was stopped");
  EXPECT_THAT(output_, HasSubstr("was stopped"));
  EXPECT_THAT(file_content(run() / "report.html"), HasSubstr("was stopped"));
}

TEST_F(CollectedFlight, TheSummaryOfAnEarlierFlightIsNoEnd) {
  const auto now = fs::file_time_type::clock::now();
  const auto earlier = now - std::chrono::hours(1);
  const fs::path summary = folder_.write("uav0/agent_summary.json", "{}");
  const fs::path status = folder_.write("uav0/status.json", "{}");
  const fs::path drone = summary.parent_path();
  const std::chrono::seconds waited(30);
  fs::last_write_time(summary, earlier);
  fs::last_write_time(status, earlier);
  EXPECT_FALSE(has_ended(drone, {now, 20})) << "it may be about to start again";
  EXPECT_TRUE(has_ended(drone, {now - waited, 20})) << "nobody has come";
  fs::last_write_time(status, now);
  EXPECT_FALSE(has_ended(drone, {now - waited, 20})) << "it flies again";
  fs::last_write_time(summary, now);
  EXPECT_TRUE(has_ended(drone, {now - waited, 20}));
}

TEST_F(CollectedFlight, ADroneThatHasNothingToFlyTakesNoEarlierFlightAway) {
  const fs::path summary = folder_.write("run/uav0/agent_summary.json", "{}");
  const fs::path gains = folder_.write("run/uav0/thermal.csv", "stamp_ns,chain_ns,gain,offset\n");
  CoveyProcess covey({"agent", "--dataset", "/nowhere", "--out", summary.parent_path().string()});
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_TRUE(fs::exists(summary));
  EXPECT_TRUE(fs::exists(gains));
}

TEST_F(CollectedFlight, ADroneThatHasGoneSilentIsNotHealthy) {
  const fs::path status = folder_.write("uav0/status.json", "{}");
  const std::vector<std::string> check = {"agent", "--is-flying", "--out",
                                          status.parent_path().string()};
  EXPECT_EQ(CoveyProcess(check).finish(), 0);
  fs::last_write_time(status, fs::file_time_type::clock::now() - std::chrono::seconds(11));
  CoveyProcess silent(check);
  EXPECT_EQ(silent.finish(), 1);
  EXPECT_THAT(silent.output(), HasSubstr("has not written its status for 10 s"));
  CoveyProcess nowhere({"agent", "--is-flying", "--out", "/nowhere"});
  EXPECT_EQ(nowhere.finish(), 1);
  EXPECT_THAT(nowhere.output(), HasSubstr("/nowhere: no drone has been here"));
  CoveyProcess somewhere({"agent", "--is-flying"});
  EXPECT_EQ(somewhere.finish(), 2);
  EXPECT_THAT(somewhere.output(), HasSubstr("--out is required"));
}

TEST_F(CollectedFlight, ASummaryThatLacksAKeyIsNamedWithIt) {
  (void)folder_.write("run/uav0/agent_summary.json", to_json(AgentSummary()).dump());
  CoveyProcess covey({"report", run().string(), "--dataset", COVEY_TEST_FLIGHT});
  EXPECT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_THAT(covey.output(), AllOf(HasSubstr("uav0/agent_summary.json"), HasSubstr("own_world")));
}

TEST_F(CollectedFlight, WhatOneDroneHasLeftBrokenCostsTheOtherNoFigures) {
  StampedPoses truth = to_trajectory(
      read_ground_truth(ground_truth_file(fs::path(COVEY_TEST_FLIGHT) / "uav0" / "mav0")));
  fs::create_directories(run() / "uav0");
  write_tum(run() / "uav0" / kTrajectoryFile, truth);
  (void)folder_.write("run/uav0/trajectory_covariance.csv", "");
  (void)folder_.write("run/uav1/timings.csv", "stamp_ns,read_ms\n1,2\n");
  (void)folder_.write("run/uav1/trajectory.tum", "1.0 0 0\n");
  (void)folder_.write("run/uav1/agent_summary.json", "{\"frames\": 3");
  CoveyProcess covey({"report", run().string(), "--dataset", COVEY_TEST_FLIGHT});
  EXPECT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_THAT(covey.output(), AllOf(HasSubstr("uav1/timings.csv:1: column 'thermal_ms'"),
                                    HasSubstr("uav1 cannot be evaluated"),
                                    HasSubstr("uav1/agent_summary.json: not valid JSON")));
  const RunSummary summary = read_run_summary(run() / "summary.json");
  EXPECT_TRUE(summary.agents.at("uav0").accuracy);
  EXPECT_FALSE(summary.agents.at("uav1").accuracy);
  EXPECT_TRUE(summary.agents.at("uav1").incomplete);
  EXPECT_TRUE(fs::exists(run() / "report.html"));
}

TEST_F(CollectedFlight, AWorldWhoseDroneHasLeftNothingIsNotJudged) {
  const json world = {{"position_m", {1, 2, 3}}, {"yaw_deg", 30}};
  json found = world;
  found.update({{"at_m", {1, 1, 1}}, {"position_sigma_m", 0.1}, {"yaw_sigma_deg", 1}});
  for (const auto& [name, peer] : {std::pair("uav0", "uav1"), std::pair("uav1", "uav0")}) {
    json summary = to_json(AgentSummary());
    summary["own_world"] = world;
    summary["peer_worlds"] = {{peer, found}, {"uav7", found}};
    (void)folder_.write(fs::path("run") / name / kAgentSummaryFile, summary.dump());
  }
  const json settings = {{"initialisation", {{"own_world", true}}},
                         {"fusion", {{"common_start", false}}}};
  const std::string own = folder_.write("own.json", settings.dump()).string();
  CoveyProcess covey({"report", run().string(), "--dataset", COVEY_TEST_FLIGHT, "--config", own});
  EXPECT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_THAT(covey.output(), HasSubstr("uav0 has found uav7's world, which cannot be judged"));
  const RunSummary summary = read_run_summary(run() / "summary.json");
  ASSERT_TRUE(summary.agents.at("uav0").alignments);
  ASSERT_EQ(summary.agents.at("uav0").alignments->count("uav1"), 1u);
  EXPECT_EQ(summary.agents.at("uav0").alignments->count("uav7"), 0u);
  // Both worlds lie and are turned alike: all that was found is wrong.
  const AlignmentSummary& alignment = summary.agents.at("uav0").alignments->at("uav1");
  const double cosine = std::sqrt(0.75), sine = 0.5;
  const double off_x = cosine - sine, off_y = sine + cosine + 1, off_z = 3;
  EXPECT_NEAR(alignment.position_error_m, std::hypot(off_x, off_y, off_z), 1e-9);
  EXPECT_NEAR(alignment.yaw_error_deg, 30, 1e-9);
  EXPECT_EQ(alignment.position_sigma_m, 0.1);
  EXPECT_EQ(alignment.yaw_sigma_deg, 1);
  fs::remove_all(run() / "uav1");
  CoveyProcess without({"report", run().string(), "--dataset", COVEY_TEST_FLIGHT, "--config", own});
  EXPECT_EQ(without.finish(), 0) << without.output();
}

TEST_F(CollectedFlight, NobodyIsWaitedForWhoNeverComes) {
  fs::create_directories(run());
  const CollectedRun collected{run(), COVEY_TEST_FLIGHT, ""};
  const auto start = fs::file_time_type::clock::now() - std::chrono::seconds(30);
  wait_for_end(collected, {start, 20, 9});  // or it would wait for ever
  EXPECT_THAT([&] { (void)summarize_collected(collected); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("holds no folder of a drone")));
}

TEST_F(CollectedFlight, WhoWaitsForTheFirstDroneSaysSo) {
  fs::create_directories(run());
  CoveyProcess covey({"report", run().string(), "--dataset", COVEY_TEST_FLIGHT, "--wait", "0.1"});
  EXPECT_TRUE(covey.wait_for("waits up to 60 s for the first")) << covey.output();
  covey.send(SIGTERM);
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), HasSubstr("holds no folder of a drone"));
}

TEST_F(CollectedFlight, WithoutAnyDroneThereIsNothingToReport) {
  fs::create_directories(run());
  CoveyProcess covey({"report", run().string(), "--dataset", COVEY_TEST_FLIGHT});
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), HasSubstr("holds no folder of a drone"));
}

}  // namespace
}  // namespace covey
