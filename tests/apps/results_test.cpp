// SPDX-License-Identifier: Apache-2.0
#include "apps/results.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

// Two drones, 10 s; each sends as many messages of that size.
RunData run_with(const std::string& exchange, std::int64_t messages, std::int64_t message_bytes,
                 std::int64_t questions) {
  RunData run;
  run.summary.exchange = exchange;
  run.start_ns = 0;
  run.end_ns = nanoseconds(10);
  for (const char* name : {"uav0", "uav1"}) {
    AgentRun agent;
    agent.name = name;
    agent.last_ns = nanoseconds(10);
    agent.accuracy.emplace().se3 = {0.3, 0.25, 0.1, {}};
    agent.alone_accuracy.emplace().se3 = {0.4, 0.35, 0.2, {}};
    agent.summary.stage_ms.track = 2.5;
    LinkSummary link;
    link.request = {questions, questions, 2000 * questions};
    link.message.sent = messages;
    link.message.payload_bytes_sent = messages * message_bytes;
    link.wire_bytes_sent = 2 * link.message.payload_bytes_sent;
    agent.summary.link = link;
    run.agents.push_back(agent);
  }
  return run;
}

std::string example() {
  const ScenarioResults yard{"mars_yard", "7", run_with("compact", 10, 5000, 5),
                             run_with("paper", 40, 300'000, 300),
                             run_with("naive", 300, 300'000, 0)};
  return results_page({yard}, {"abc1234", "2 cores, Test", "scripts/tables mars_yard-7"});
}

TEST(Results, SayWhereTheyComeFrom) {
  EXPECT_THAT(example(),
              HasSubstr("`scripts/tables mars_yard-7` at commit abc1234 on 2 cores, Test"));
}

TEST(Results, ErrorsStandBesideThePrintedOnes) {
  EXPECT_THAT(example(),
              HasSubstr("| mars_yard, seed 7 | uav1 | - | 0.4000±0.2000 | 0.3000±0.1000 | 25.0 % | "
                        "0.0813±0.0382 | 0.0438±0.0189 | 46.1 % |"));
}

TEST(Results, DataIsSummedOverTheTeamAndComparedWithCompact) {
  // compact: 2 x (10 x 5000 + 5 x 2000) bytes; naive: 2 x 300 x 300 kB.
  EXPECT_THAT(example(),
              AllOf(HasSubstr("| compact | 10 | 20 | 0.12 | 6.0 | 0.20 | 10.0 | 1 / 1 | - | 0.3"),
                    HasSubstr("| naive | 0 | 600 | 180.00 | 9000.0 | 360.00 | 18000.0 | "
                              "1500 / 1800 | 114.4 | 0.3"),
                    HasSubstr("| paper | 600 | 80 | 25.20 | "),
                    HasSubstr("| mars_yard | 234.37 | 22.88 | 2.51 | 1953 | 212 |")));
}

TEST(Results, AModuleThatDidNotRunIsADash) {
  EXPECT_THAT(example(), AllOf(HasSubstr("| tracking | 2.50 | 13.45 |"),
                               HasSubstr("| photometric calibration | - | 22.53 |"),
                               HasSubstr("| **total** | 2.50 | 53.07 |")));
}

TEST(Results, AMissingRunIsNamed) {
  const TemporaryFolder folder;
  EXPECT_THAT([&] { (void)read_results(folder.path() / "none"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("none: is not a folder")));
  const auto read = [&] { (void)read_results(folder.path()); };
  EXPECT_THAT(read, ThrowsMessage<std::runtime_error>(HasSubstr("holds no flights")));
  std::filesystem::create_directories(folder.path() / "mars_yard-7");
  EXPECT_THAT(read, ThrowsMessage<std::runtime_error>(HasSubstr("mars_yard-7/compact")));
}

TEST(Results, ARunInTheFolderOfAnotherExchangeIsNamed) {
  const TemporaryFolder folder;
  RunSummary summary;
  summary.exchange = "compact";
  summary.agents["uav0"] = {};
  for (const char* exchange : {"compact", "paper", "naive"}) {
    const auto run = folder.path() / "mars_yard-7" / exchange;
    std::filesystem::create_directories(run);
    write_run_summary(run / "summary.json", summary);
  }
  EXPECT_THAT([&] { (void)read_results(folder.path()); },
              ThrowsMessage<std::runtime_error>(
                  HasSubstr("paper/summary.json: was flown with --exchange compact, not paper")));
}

}  // namespace
}  // namespace covey
