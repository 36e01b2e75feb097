// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "apps/team_summary.h"

namespace covey {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::Not;

AgentSummary drone(double as_it_stands_m, double aligned_m) {
  AgentSummary agent;
  agent.accuracy.emplace();
  agent.accuracy->none.rmse = as_it_stands_m;
  agent.accuracy->se3.rmse = aligned_m;
  return agent;
}

RunSummary team(const std::string& mode, const AgentSummary& uav0, const AgentSummary& uav1) {
  RunSummary run;
  run.mode = mode;
  run.agents = {{"uav0", uav0}, {"uav1", uav1}};
  return run;
}

TEST(TeamTable, SaysWhatTogetherIsWorth) {
  const RunSummary alone = team("solo", drone(0.2, 0.1), drone(0.4, 0.1));
  const RunSummary together = team("collaborative", drone(0.1, 0.05), drone(0.2, 0.03));
  EXPECT_THAT(team_table(together, &alone), HasSubstr("0.40 aligned, 0.50 as they stand"));
  EXPECT_THAT(team_table(together, nullptr), Not(HasSubstr("as they stand\n")));
}

TEST(TeamTable, ComparesDronesThatHaveBothErrors) {
  const RunSummary alone = team("solo", drone(0.2, 0.1), AgentSummary());
  const RunSummary together = team("collaborative", drone(0.1, 0.05), drone(0.2, 9));
  EXPECT_THAT(team_table(together, &alone), HasSubstr("0.50 aligned, 0.50 as they stand"));
  const RunSummary without = team("collaborative", AgentSummary(), AgentSummary());
  EXPECT_THAT(team_table(without, &alone),
              AllOf(Not(HasSubstr("aligned")), Not(HasSubstr("RMSE"))));
}

TEST(TeamTable, SaysWhoDidNotStartAndWhy) {
  AgentSummary waiting;
  waiting.not_started = "it never stood still";
  EXPECT_THAT(team_table(team("solo", drone(0.1, 0.1), waiting), nullptr),
              HasSubstr("did not start: it never stood still\n"));
}

}  // namespace
}  // namespace covey
