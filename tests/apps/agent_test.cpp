// SPDX-License-Identifier: Apache-2.0
//
// One agent's process by itself, and how it talks with its team.
#include "apps/agent.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <sys/socket.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <optional>

#include "apps/earlier_flight.h"
#include "apps/free_domain.h"
#include "apps/link_figures.h"
#include "apps/trajectory_file.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/full_disk.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

TEST(ControlChannel, CommandsAndRepliesSurviveTheWire) {
  const auto receive =
      std::get<ReceiveCommand>(decode_command(encode(Command{ReceiveCommand{{3, 4}, 500}})));
  EXPECT_EQ(receive.expected.requests, 3U);
  EXPECT_EQ(receive.expected.messages, 4U);
  EXPECT_EQ(receive.patience_ms, 500);
  const auto go =
      std::get<GoCommand>(decode_command(encode(Command{GoCommand{0.1 + 0.2, 1'403'715'273}})));
  EXPECT_EQ(go.start_ms, 0.1 + 0.2);
  EXPECT_EQ(go.first_ns, 1'403'715'273);
  AdvancedReply advanced;
  advanced.done = true;
  advanced.reached_ns = 1'403'715'273'262'142'976;
  advanced.requests_sent = 5;
  advanced.messages_sent_to = {{"uav1", 6}};
  advanced.memory_mib = 61.5;
  const auto reply = std::get<AdvancedReply>(decode_reply(encode(Reply{advanced})));
  EXPECT_TRUE(reply.done);
  EXPECT_EQ(reply.reached_ns, advanced.reached_ns);
  EXPECT_EQ(reply.requests_sent, 5U);
  EXPECT_EQ(reply.messages_sent_to, advanced.messages_sent_to);
  EXPECT_EQ(reply.memory_mib, 61.5);
  const auto failed = std::get<FailedReply>(decode_reply(encode(Reply{FailedReply{"no words"}})));
  EXPECT_EQ(failed.why, "no words");
}

// A name that is written in another encoding, say.
TEST(ControlChannel, AReasonThatIsNotUtf8StillArrives) {
  const std::string line = encode(Reply{FailedReply{"b\xfcld.png does not exist"}});
  EXPECT_EQ(std::get<FailedReply>(decode_reply(line)).why, "b\uFFFDld.png does not exist");
}

TEST(ControlChannel, AnythingElseIsRefused) {
  EXPECT_THROW((void)decode_command("hello"), std::runtime_error);
  EXPECT_THROW((void)decode_command(R"({"do":"dance"})"), std::runtime_error);
  EXPECT_THROW((void)decode_command(R"({"do":"advance"})"), std::runtime_error);
  EXPECT_THROW((void)decode_reply(R"({"is":"ready","first_ns":"now"})"), std::runtime_error);
}

TEST(ControlChannel, LinesArriveWholeAndTheEndIsNoticed) {
  int ends[2];
  ASSERT_EQ(socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
  LineChannel here(ends[0]);
  {
    LineChannel there(ends[1]);
    EXPECT_EQ(here.take_line(), std::nullopt);
    EXPECT_FALSE(here.closed());
    EXPECT_TRUE(there.send("one"));
    EXPECT_TRUE(there.send("two"));
  }
  EXPECT_EQ(here.take_line(), "one");
  EXPECT_EQ(here.take_line(), "two");
  EXPECT_EQ(here.take_line(), std::nullopt);
  EXPECT_TRUE(here.closed());
  EXPECT_FALSE(here.send("three"));
}

TEST(CpuLoadMonitor, KeepsTheHighestShareOverWindowsOfASecond) {
  CpuLoadMonitor monitor;
  monitor.sample(0, 0);
  monitor.sample(500, 0.4);
  EXPECT_EQ(monitor.max_percent(), std::nullopt);
  monitor.sample(1000, 0.5);
  EXPECT_NEAR(*monitor.max_percent(), 50, 1e-9);
  monitor.sample(3000, 2.1);
  EXPECT_NEAR(*monitor.max_percent(), 80, 1e-9);
  monitor.sample(4000, 2.1);
  EXPECT_NEAR(*monitor.max_percent(), 80, 1e-9);
}

TEST(AgentStatus, IsToldAtFirstOnChangeAndEveryFiveSeconds) {
  AgentStatus status;
  status.stamp_ns = nanoseconds(100);
  EXPECT_TRUE(is_status_due(std::nullopt, status));
  const AgentStatus told = status;
  EXPECT_FALSE(is_status_due(told, status));
  status.stamp_ns = nanoseconds(104.99);
  EXPECT_FALSE(is_status_due(told, status));
  status.stamp_ns = nanoseconds(105);
  EXPECT_TRUE(is_status_due(told, status));
  status.stamp_ns = nanoseconds(100.05);
  status.status = FilterStatus::kTracking;
  EXPECT_TRUE(is_status_due(told, status)) << "a change does not wait";
}

TEST(WordsOnPeers, NameWhoIsThereAndWhyOthersWereNotHeard) {
  LinkStatistics statistics;
  EXPECT_EQ(words_on_peers({}, 2, statistics), "0 of 2 peers found");
  statistics.rejected["uav2"]["other wire version"] = 3;
  statistics.rejected["unknown"]["malformed packet"] = 1;
  EXPECT_EQ(words_on_peers({"uav1", "uav3"}, 3, statistics),
            "2 of 3 peers found: uav1, uav3; rejected: uav2 (other wire version, 3 times), "
            "unknown (malformed packet, 1 times)");
}

TEST(Agent, FliesAloneWithoutATeam) {
  const fs::path out = fs::path(testing::TempDir()) / "covey_agent_alone";
  fs::remove_all(out);
  const fs::path config = out.string() + ".json";
  std::ofstream(config) << R"({"agent": {"mode": "solo", "duration_s": 0.5}})";
  CoveyProcess covey({"agent", "--config", config.string(), "--name", "scout", "--dataset",
                      std::string(COVEY_TEST_FLIGHT) + "/uav0/mav0", "--out", out.string()});
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_THAT(covey.output(), AllOf(HasSubstr("scout: "), HasSubstr("results in " + out.string())));
  const AgentSummary summary =
      agent_summary_from_json(json::parse(file_content(out / kAgentSummaryFile)), "summary");
  EXPECT_GT(summary.frames, 5);
  EXPECT_GT(*summary.cpu_ms_per_frame, 0);
  EXPECT_EQ(read_timings(out / kTimingsFile).size(), static_cast<std::size_t>(summary.frames));
  EXPECT_TRUE(json::parse(file_content(out / kAgentStatusFile)).contains("frames"));
  const auto camera = read_camera_changes(out / kAgentSummaryFile);
  ASSERT_TRUE(camera.has_value());
  EXPECT_EQ(camera->time_offset_s.sigma_at_start[0], AgentConfig().estimator.time_offset_sigma_s);
  fs::remove_all(out);
}

// A recording of which files can be spoiled.
class SpoiledRecording : public testing::Test {
 protected:
  SpoiledRecording() {
    fs::copy(fs::path(COVEY_TEST_FLIGHT) / "uav0" / "mav0", mav0_, fs::copy_options::recursive);
    for (const auto& entry : fs::directory_iterator(mav0_ / "cam0" / "data"))
      images_.push_back(entry.path());
    std::sort(images_.begin(), images_.end());
  }
  void cut_short(std::size_t image) const { fs::resize_file(images_.at(image), 1000); }
  [[nodiscard]] std::vector<std::string> command(const std::string& pace) const {
    const json settings = {{"agent",
                            {{"mode", "solo"},
                             {"pace", pace},
                             {"real_time_factor", 4},
                             {"image_queue", 1000},
                             {"dataset", mav0_},
                             {"out", out_}}}};
    return {"agent", "--config", folder_.write("config.json", settings.dump()).string()};
  }

  TemporaryFolder folder_;
  const fs::path mav0_ = folder_.path() / "mav0", out_ = folder_.path() / "out";
  std::vector<fs::path> images_;
};

class SpoiledAtAnyPace : public SpoiledRecording,
                         public testing::WithParamInterface<const char*> {};

TEST_P(SpoiledAtAnyPace, ImagesThatCannotBeReadAreLeftOutAndCounted) {
  for (const std::size_t image : {0, 20, 21}) cut_short(image);
  fs::remove(images_[30]);
  CoveyProcess covey(command(GetParam()));
  EXPECT_EQ(covey.finish(), 0) << covey.output();
  EXPECT_THAT(covey.output(), HasSubstr(images_[0].string() + ": image is damaged or cut short"));
  EXPECT_THAT(covey.output(), Not(HasSubstr(images_[20].string()))) << "told once";
  EXPECT_THAT(covey.output(),
              HasSubstr("1 of " + std::to_string(COVEY_TEST_FLIGHT_FRAMES) +
                        " images are not there, the first of them " + images_[30].string()));
  const json summary = json::parse(file_content(out_ / kAgentSummaryFile));
  EXPECT_EQ(summary["frames"], COVEY_TEST_FLIGHT_FRAMES - 4);
  EXPECT_EQ(summary["frames_dropped"], 4);
}

INSTANTIATE_TEST_SUITE_P(Paces, SpoiledAtAnyPace, testing::Values("max", "rate"),
                         [](const auto& pace) { return std::string(pace.param); });

TEST_F(SpoiledRecording, OfWhichNoImageCanBeReadIsNotFlown) {
  for (std::size_t i = 0; i < images_.size(); ++i) cut_short(i);
  CoveyProcess covey(command("max"));
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), HasSubstr("no image can be read: " + images_.back().string()));
  EXPECT_FALSE(fs::exists(out_));
}

TEST(StatusFile, IsDueASecondAfterItWasWritten) {
  const TemporaryFolder folder;
  const fs::path file = folder.path() / kAgentStatusFile;
  StatusFile status(file);
  EXPECT_EQ(json::parse(file_content(file)), json({{"frames", 0}})) << "there from the start";
  status.write({{"frames", 7}}, 5000);
  EXPECT_EQ(json::parse(file_content(file))["frames"], 7);
  EXPECT_FALSE(status.due(5999));
  EXPECT_TRUE(status.due(6000));
}

TEST(StatusFile, ThatCannotBeWrittenEndsNoFlightAndIsSaidOnce) {
  const TemporaryFolder folder;
  (void)folder.write("status.json/in_the_way", "");
  testing::internal::CaptureStdout();  // where this program's log goes
  StatusFile status(folder.path() / "status.json");
  status.write({{"frames", 7}}, 5000);
  spdlog::default_logger()->flush();
  const std::string said = testing::internal::GetCapturedStdout();
  const std::size_t first = said.find("status.json: is a folder");
  ASSERT_NE(first, std::string::npos) << said;
  EXPECT_EQ(said.find("status.json", first + 1), std::string::npos) << "one line is enough";
}

TEST(Agent, ItsStatusCountsTheImagesThatItDrops) {
  const TemporaryFolder folder;
  const json settings = {
      {"agent",
       {{"mode", "solo"}, {"pace", "rate"}, {"real_time_factor", 100}, {"image_queue", 1}}}};
  const fs::path config = folder.write("agent.json", settings.dump());
  const fs::path out = folder.path() / "out";
  CoveyProcess covey({"agent", "--config", config.string(), "--dataset",
                      std::string(COVEY_TEST_FLIGHT) + "/uav0/mav0", "--out", out.string()});
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  const json status = json::parse(file_content(out / kAgentStatusFile));
  const json summary = json::parse(file_content(out / kAgentSummaryFile));
  EXPECT_EQ(status["frames_dropped"], summary["frames_dropped"]);
  EXPECT_EQ(status["frames"].get<int>() + status["frames_dropped"].get<int>(),
            COVEY_TEST_FLIGHT_FRAMES);
}

TEST(Agent, AFullDiskEndsNoFlightAndIsToldInItsSummary) {
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "uav0";
  const fs::path config = folder.write("agent.json", R"({"agent": {"mode": "solo"}})");
  // Wide enough for the summary, too small for the covariances of three seconds.
  std::optional<FullDisk> full(std::in_place, 6000);
  CoveyProcess covey({"agent", "--config", config.string(), "--dataset",
                      std::string(COVEY_TEST_FLIGHT) + "/uav0/mav0", "--out", out.string()});
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  full.reset();
  EXPECT_THAT(covey.output(), HasSubstr("trajectory_covariance.csv: cannot be written"));
  const AgentSummary summary =
      agent_summary_from_json(json::parse(file_content(out / kAgentSummaryFile)), "summary");
  EXPECT_EQ(summary.frames, COVEY_TEST_FLIGHT_FRAMES);
  const auto poses = static_cast<std::int64_t>(read_covariances(out / kCovarianceFile).size());
  EXPECT_GT(poses, 0);
  ASSERT_EQ(summary.lost_lines.count(kCovarianceFile), 1u);
  EXPECT_GT(summary.lost_lines.at(kCovarianceFile), 0);

  CoveyProcess report({"report", folder.path().string(), "--dataset", COVEY_TEST_FLIGHT});
  EXPECT_EQ(report.finish(), 0) << report.output();
  EXPECT_THAT(report.output(), HasSubstr("lines of trajectory_covariance.csv lost"));
  EXPECT_THAT(file_content(folder.path() / "report.html"),
              HasSubstr("lines of trajectory_covariance.csv are missing"));
}

TEST(Agent, PrintsASettingForEveryKeyAndReadsThemBack) {
  CoveyProcess print({"agent", "--print-config"});
  ASSERT_EQ(print.finish(), 0);
  EXPECT_EQ(print.output(), print_config(AgentConfig()));
  CoveyProcess describe({"agent", "--describe-config"});
  ASSERT_EQ(describe.finish(), 0);
  EXPECT_THAT(describe.output(), HasSubstr("estimator.gravity"));
}

TEST(Agent, SaysInOneLineWhatIsMissing) {
  CoveyProcess nothing({"agent"});
  EXPECT_EQ(nothing.finish(), 2);
  EXPECT_THAT(nothing.output(), HasSubstr("--config"));
  CoveyProcess dataset({"agent", "--dataset", "/nowhere", "--out", testing::TempDir()});
  EXPECT_EQ(dataset.finish(), 1);
  EXPECT_THAT(dataset.output(), AllOf(HasSubstr("covey: uav0: "), HasSubstr("/nowhere")));
  EXPECT_EQ(std::count(dataset.output().begin(), dataset.output().end(), '\n'), 1);
}

TEST(Agent, AStartThatFailsLeavesAnEarlierFlight) {
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "out";
  for (const char* file : {kTrajectoryFile, kAgentSummaryFile, kAgentStatusFile})
    (void)folder.write(fs::path("out") / file, "old");
  const std::pair<const char*, const char*> mistakes[] = {
      {R"({"agent": {"vocabulary": "/no/words.txt"}})", "/no/words.txt"},
      {R"({"link": {"loopback_only": false, "interfaces": ["203.0.113.7"]}})", "203.0.113.7"},
      {R"({"agent": {"mode": "solo", "pace": "lockstep"}})", "needs a team"}};
  for (const auto& [settings, complaint] : mistakes) {
    const fs::path config = folder.write("agent.json", settings);
    CoveyProcess covey({"agent", "--config", config.string(), "--dataset",
                        std::string(COVEY_TEST_FLIGHT) + "/uav0/mav0", "--out", out.string()});
    EXPECT_EQ(covey.finish(), 1);
    EXPECT_THAT(covey.output(), HasSubstr(complaint));
    for (const char* file : {kTrajectoryFile, kAgentSummaryFile, kAgentStatusFile})
      EXPECT_EQ(file_content(out / file), "old") << complaint << ": " << file;
  }
}

TEST(Agent, AnEarlierFlightIsSetAsideNotLost) {
  const TemporaryFolder folder;
  const std::string flown = std::string(kTumHeader) + "\n1.0 0 0 0 0 0 0 1\n";
  (void)folder.write(kTrajectoryFile, flown);
  (void)folder.write(kAgentSummaryFile, "{}");
  (void)folder.write("notes.txt", "of the pilot");
  EXPECT_EQ(set_aside_earlier_flight(folder.path()), folder.path() / "earlier/1");
  EXPECT_EQ(file_content(folder.path() / "earlier/1" / kTrajectoryFile), flown);
  EXPECT_EQ(file_content(folder.path() / "earlier/1" / kAgentSummaryFile), "{}");
  EXPECT_FALSE(fs::exists(folder.path() / kTrajectoryFile));
  EXPECT_FALSE(fs::exists(folder.path() / kAgentSummaryFile));
  EXPECT_TRUE(fs::exists(folder.path() / "notes.txt"));

  (void)folder.write(kTrajectoryFile, flown);
  EXPECT_EQ(set_aside_earlier_flight(folder.path()), folder.path() / "earlier/2");
}

TEST(Agent, WhatNeverFlewIsNotKept) {
  const TemporaryFolder folder;
  EXPECT_EQ(set_aside_earlier_flight(folder.path()), std::nullopt);
  (void)folder.write(kTrajectoryFile, std::string(kTumHeader) + "\n");
  (void)folder.write(kAgentStatusFile, "{}");
  EXPECT_EQ(set_aside_earlier_flight(folder.path()), std::nullopt);
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(Agent, WithoutATeamThereIsNoLockstep) {
  const fs::path config = fs::path(testing::TempDir()) / "covey_agent_lockstep.json";
  std::ofstream(config) << R"({"agent": {"mode": "solo", "pace": "lockstep"}})";
  CoveyProcess covey({"agent", "--config", config.string(), "--dataset",
                      std::string(COVEY_TEST_FLIGHT) + "/uav0/mav0", "--out",
                      (fs::path(testing::TempDir()) / "covey_agent_lockstep").string()});
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), HasSubstr("needs a team"));
}

}  // namespace
}  // namespace covey
