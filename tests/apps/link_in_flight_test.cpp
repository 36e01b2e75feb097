// SPDX-License-Identifier: Apache-2.0
//
// Teams whose links' processes are killed and stopped in flight.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <nlohmann/json.hpp>

#include "apps/agent.h"
#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"
#include "tests/comms/eventually.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;

// Not when nobody has waited for its end yet.
bool runs(pid_t process) {
  const std::string status = file_content("/proc/" + std::to_string(process) + "/status");
  return !status.empty() && status.find("\nState:\tZ") == std::string::npos;
}

class LinkInFlight : public testing::Test {
 protected:
  [[nodiscard]] fs::path run() const { return folder_.path() / "run"; }

  // By the clock, so that the links have processes; no image is late, however busy the machine.
  [[nodiscard]] std::vector<std::string> team(const std::string& pace) {
    const json settings = {{"agent", {{"image_queue", 1000}}}};
    const fs::path config = folder_.write("team.json", settings.dump());
    return {"team",  COVEY_TEST_FLIGHT, "--config", config.string(),
            "--out", run().string(),    "--pace",   pace};
  }

  [[nodiscard]] std::optional<pid_t> agent(const std::string& drone) const {
    return find_process((run() / drone / kAgentConfigFile).string());
  }

  [[nodiscard]] std::optional<pid_t> link_of(const std::string& drone) const {
    const auto parent = agent(drone);
    if (!parent) return std::nullopt;
    const auto children = children_of(*parent);
    return children.empty() ? std::nullopt : std::optional(children.front());
  }

  TemporaryFolder folder_;
};

TEST_F(LinkInFlight, AKilledAndAStoppedOneCostNoImageAndAreNamed) {
  CoveyProcess covey(team("0.7"));
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  ASSERT_EQ(kill(link_of("uav0").value(), SIGKILL), 0);
  ASSERT_EQ(kill(link_of("uav1").value(), SIGSTOP), 0);
  ASSERT_EQ(covey.finish(), 0) << covey.output();

  EXPECT_THAT(covey.output(),
              HasSubstr("uav0: warning: the link is started anew: killed by signal 9 "
                        "(SIGKILL)"));
  EXPECT_THAT(covey.output(), HasSubstr("link restarted 1 times"));
  const json agents = json::parse(file_content(run() / "summary.json"))["agents"];
  for (const char* drone : {"uav0", "uav1"}) {
    EXPECT_EQ(agents[drone]["frames"], COVEY_TEST_FLIGHT_FRAMES);
    EXPECT_EQ(agents[drone]["frames_dropped"], 0);
    const json status = json::parse(file_content(run() / drone / kAgentStatusFile));
    EXPECT_EQ(status["link_restarts"], agents[drone]["link"]["restarts"]);
  }
  EXPECT_EQ(agents["uav0"]["link"]["restarts"]["killed by signal 9 (SIGKILL)"], 1);
  EXPECT_EQ(agents["uav1"]["link"]["restarts"]["did not report"], 1);
}

TEST_F(LinkInFlight, ItDoesNotOutliveItsDrone) {
  CoveyProcess covey(team("0.2"));
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  const pid_t link = link_of("uav0").value();
  ASSERT_EQ(kill(agent("uav0").value(), SIGKILL), 0);
  EXPECT_TRUE(eventually([link] { return !runs(link); }));
  covey.send(SIGINT);
  EXPECT_EQ(covey.finish(), 1);
}

TEST_F(LinkInFlight, ItIsNothingThatAPersonStarts) {
  CoveyProcess covey({"link", "--fd", "99"});
  EXPECT_EQ(covey.finish(), 1);
  EXPECT_THAT(covey.output(), HasSubstr("covey: link: --fd 99 is no socket"));
  EXPECT_EQ(std::count(covey.output().begin(), covey.output().end(), '\n'), 1);
}

TEST_F(LinkInFlight, InLockstepThereIsNoOtherProcess) {
  CoveyProcess covey({"team", COVEY_TEST_FLIGHT, "--out", run().string()});
  ASSERT_TRUE(covey.wait_for("flown")) << covey.output();
  EXPECT_FALSE(link_of("uav0"));
  ASSERT_EQ(covey.finish(), 0) << covey.output();
}

}  // namespace
}  // namespace covey
