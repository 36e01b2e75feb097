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
using testing::Not;
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

ScenarioResults flight_of(const std::string& scenario) {
  return {scenario,
          "7",
          run_with("compact", 10, 5000, 5),
          run_with("paper", 40, 300'000, 300),
          run_with("naive", 300, 300'000, 0),
          std::nullopt};
}

std::string page_of(const ScenarioResults& flight) {
  return results_page({flight}, {"abc1234", "2 cores, Test", "scripts/tables mars_yard-7"});
}

std::string example() { return page_of(flight_of("mars_yard")); }

TEST(Results, SayWhereTheyComeFrom) {
  EXPECT_THAT(example(),
              HasSubstr("`scripts/tables mars_yard-7` at commit abc1234 on 2 cores, Test"));
}

TEST(Results, ErrorsStandBesideThePrintedOnes) {
  const std::string page = page_of(flight_of("castle_parallel"));
  EXPECT_THAT(page, HasSubstr("| castle_parallel, seed 7 | uav1 | - | 0.4000±0.2000 | "
                              "0.3000±0.1000 | 25.0 % | "
                              "0.4817±0.3039 | 0.3871±0.1860 | 19.6 % |"));
  EXPECT_THAT(page, Not(HasSubstr("### Thermal")));
}

TEST(Results, ThermalErrorsStandRawAndCalibratedBesideThePrintedOnes) {
  ScenarioResults yard = flight_of("mars_yard");
  yard.raw = run_with("compact", 10, 5000, 5);
  yard.raw->agents[1].accuracy->se3 = {0.5, 0.4, 0.1, {}};
  yard.raw->agents[1].alone_accuracy->se3 = {0.6, 0.5, 0.2, {}};
  const std::string page = page_of(yard);
  EXPECT_THAT(
      page, HasSubstr("| flight | drone | path, m | alone, raw | alone, calibrated | together, raw "
                      "| together, calibrated | paper: alone, raw | paper: alone, calibrated | "
                      "paper: together, raw | paper: together, calibrated |"));
  EXPECT_THAT(page, HasSubstr("| mars_yard, seed 7 | uav1 | - | 0.6000±0.2000 | 0.4000±0.2000 | "
                              "0.5000±0.1000 | 0.3000±0.1000 | 0.0813±0.0382 | 0.0621±0.0248 | "
                              "0.0812±0.0381 | 0.0438±0.0189 |"));
  EXPECT_THAT(page, HasSubstr("| mars_yard, seed 7 | **mean** | - | 0.5000 | 0.4000 | 0.4000 | "
                              "0.3000 | 0.1324 | 0.1263 | 0.1336 | 0.1024 |"));
  EXPECT_THAT(page, Not(HasSubstr("### Visual")));
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

void write_thermal_run(const std::filesystem::path& run, const std::string& exchange,
                       bool calibrated) {
  std::filesystem::create_directories(run);
  RunSummary summary;
  summary.exchange = exchange;
  AgentSummary& drone = summary.agents["uav0"];
  if (calibrated) drone.stage_ms.thermal = 3;
  write_run_summary(run / "summary.json", summary);
}

TEST(Results, ThermalFlightsAreFlownOnRawImagesAsWell) {
  const TemporaryFolder folder;
  const auto flight = folder.path() / "mars_yard-7";
  for (const char* exchange : {"compact", "paper", "naive"})
    write_thermal_run(flight / exchange, exchange, true);
  const auto read = [&] { return read_results(folder.path()); };
  EXPECT_THAT(read, ThrowsMessage<std::runtime_error>(AllOf(
                        HasSubstr("mars_yard-7/raw holds no run"), HasSubstr("--thermal raw"))));
  write_thermal_run(flight / "raw", "compact", true);
  EXPECT_THAT(read, ThrowsMessage<std::runtime_error>(
                        HasSubstr("raw/summary.json: images were calibrated")));
  write_thermal_run(flight / "raw", "compact", false);
  EXPECT_TRUE(read().front().raw.has_value());
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
