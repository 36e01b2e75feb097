// SPDX-License-Identifier: Apache-2.0
//
// Drones that fly, and another vendor's client that listens and asks
// (tests/comms/cyclone_client.cpp).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <vector>

#include "apps/agent.h"
#include "apps/run_files.h"
#include "apps/trajectory_file.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"
#include "tests/comms/cyclone_process.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AnyOf;
using testing::Contains;
using testing::Gt;
using testing::IsEmpty;
using testing::Not;

class CycloneFlight : public testing::Test {
 protected:
  void SetUp() override {
    if (std::string(COVEY_CYCLONE_CLIENT).empty()) GTEST_SKIP() << kNoCyclone;
  }

  [[nodiscard]] fs::path out(const std::string& drone) const { return folder_.path() / drone; }

  [[nodiscard]] std::vector<std::string> agent(const std::string& drone) {
    const json settings = {
        {"agent", {{"pace", "rate"}, {"wait_for_peers", 1}, {"image_queue", 1000}}},
        {"link",
         {{"team", team_.team},
          {"domain", team_.domain},
          // docs/link.md: otherwise Cyclone skips each drone's first answer.
          {"override", {{"message.piggyback", false}}}}}};
    return {"agent",
            "--config",
            folder_.write(drone + ".json", settings.dump()).string(),
            "--name",
            drone,
            "--dataset",
            std::string(COVEY_TEST_FLIGHT) + "/" + drone + "/mav0",
            "--out",
            out(drone).string()};
  }

  const LinkConfig team_ = team_config("");
  TemporaryFolder folder_;
};

using Told = std::map<std::string, std::vector<json>>;  // by topic

// Until both drones have answered and been heard to fly.
Told told_by(CycloneClient& client) {
  Told told;
  std::set<std::string> answered;
  while (answered.size() < 2 || told["odometry"].empty()) {
    const auto sample = client.next(kPatience);
    if (!sample) break;
    told[(*sample)["topic"]].push_back(*sample);
    if ((*sample)["topic"] == "message") answered.insert((*sample)["sender"]);
  }
  return told;
}

void expect_flown(const json& odometry, const StampedPoses& trajectory) {
  const auto flown = std::find_if(trajectory.begin(), trajectory.end(), [&](const auto& pose) {
    return pose.stamp_ns == odometry["stamp_ns"];
  });
  ASSERT_NE(flown, trajectory.end());
  for (int axis = 0; axis < 3; ++axis)
    EXPECT_NEAR(odometry["p_world_imu"][axis], flown->pose.p_world_imu[axis], 1e-8);
}

void expect_well_formed(const json& answer) {
  const int landmarks = answer["inverse_depths"];
  EXPECT_EQ(answer["receiver"], "ground");
  EXPECT_GE(landmarks, 8);
  EXPECT_THAT(answer["descriptors"].get<int>(), AnyOf(8 * landmarks, 0)) << "0: a brief question";
  EXPECT_EQ(answer["bearings"], 2 * landmarks);
  EXPECT_EQ(answer["depth_sigmas"], landmarks);
  EXPECT_EQ(answer["patches"], 8 * landmarks);
}

// What became of a question and its answer in one drone.
std::set<ExchangeEvent> events_of(std::uint64_t question, const fs::path& drone) {
  std::set<ExchangeEvent> events;
  for (const ExchangeRecord& record : read_exchange(drone / kExchangeFile))
    if (record.keyframe_id == question) events.insert(record.event);
  return events;
}

TEST_F(CycloneFlight, IsToldOfItAndAnsweredAlone) {
  CycloneClient client(team_, "ground");
  CoveyProcess uav0(agent("uav0")), uav1(agent("uav1"));
  Told told = told_by(client);
  ASSERT_EQ(uav0.finish(), 0) << uav0.output();
  ASSERT_EQ(uav1.finish(), 0) << uav1.output();
  EXPECT_EQ(client.finish(), 0);

  EXPECT_FALSE(told["request"].empty());
  EXPECT_FALSE(told["status"].empty());
  for (const json& odometry : told["odometry"])
    expect_flown(odometry, read_trajectory(out(odometry["agent"]) / kTrajectoryFile));

  ASSERT_GE(told["message"].size(), 2U);
  for (const json& answer : told["message"]) {
    expect_well_formed(answer);
    const std::uint64_t question = answer["request_keyframe_id"];
    EXPECT_THAT(events_of(question, out(answer["sender"])), Contains(ExchangeEvent::kAnswered));
    for (const char* drone : {"uav0", "uav1"})
      EXPECT_THAT(events_of(question, out(drone)), Not(Contains(Gt(ExchangeEvent::kAnswered))));
  }
  for (const char* drone : {"uav0", "uav1"}) {
    const json summary = json::parse(file_content(out(drone) / kAgentSummaryFile));
    EXPECT_THAT(summary["exchange_details"]["rejected_by_link"], IsEmpty());
    // One status each way is enough, and the client has none.
    const json status = json::parse(file_content(out(drone) / kAgentStatusFile));
    EXPECT_EQ(status["clocks"].size(), 1U) << status;
    EXPECT_EQ(summary["link"]["clocks"].size(), 1U);
  }
}

}  // namespace
}  // namespace covey
