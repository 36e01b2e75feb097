// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_figures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <set>

#include "apps/lab_flight.h"
#include "apps/lab_report.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using testing::HasSubstr;
using testing::Not;

std::string content_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

constexpr auto kAsked = ExchangeEvent::kAsked, kHeard = ExchangeEvent::kHeard,
               kAnswered = ExchangeEvent::kAnswered, kFused = ExchangeEvent::kFused,
               kGated = ExchangeEvent::kGated;

TEST(LabFigures, CountWhatArrivedInTimeOfWhatWasAnswered) {
  const ExchangeLogs logs{
      {"a",
       {{1000, kAsked, "*", 1},
        {1100, kFused, "b", 1},
        {2000, kAsked, "*", 2},
        {2700, kFused, "b", 2},
        {3000, kAsked, "*", 3},
        {3300, kGated, "c", 3}}},
      {"b",
       {{1040, kHeard, "a", 1},
        {1050, kAnswered, "a", 1},
        {2030, kHeard, "a", 2},
        {2100, kAnswered, "a", 2}}},
      {"c",
       {{3010, kHeard, "a", 3},
        {3100, kAnswered, "a", 3},
        {3200, kHeard, "a", 2},
        {3210, kAnswered, "a", 2}}},  // on its way for ever
  };
  LabFigures figures;
  judge_exchange(logs, figures);
  EXPECT_EQ(figures.asked, 3);
  EXPECT_NEAR(*figures.heard_share, 4.0 / 6, 1e-12);  // of three questions to two drones each
  EXPECT_EQ(figures.answers, 4);
  EXPECT_NEAR(*figures.arrived_share, 3.0 / 4, 1e-12);
  EXPECT_EQ(figures.fused, 2);
  EXPECT_NEAR(*figures.arrived_500ms_share, 2.0 / 4, 1e-12);
  EXPECT_NEAR(*figures.fused_500ms_share, 1.0 / 4, 1e-12);
  EXPECT_EQ(figures.round_trip_ms, 300);  // of 100, 300, 700
  EXPECT_EQ(figures.round_trip_p95_ms, 700);
  EXPECT_EQ(figures.delivery_ms, 200);  // of 50, 200, 600
}

TEST(LabFigures, AnAnswerUnderWayAtTheEndOfAFlightIsNeitherInTimeNorLate) {
  const ExchangeLogs logs{
      {"a",
       {{1000, kAsked, "*", 1},
        {1100, kFused, "b", 1},
        {2000, kAsked, "*", 2},
        {2600, kAsked, "*", 3},
        {2650, kHeard, "b", 7}}},  // its last sign of life
      {"b", {{1050, kAnswered, "a", 1}, {2050, kAnswered, "a", 2}, {2640, kAnswered, "a", 3}}},
  };
  LabFigures figures;
  judge_exchange(logs, figures);
  EXPECT_EQ(figures.answers, 3);
  EXPECT_NEAR(*figures.arrived_share, 1.0 / 3, 1e-12);
  EXPECT_NEAR(*figures.arrived_500ms_share, 1.0 / 2, 1e-12) << "of 1 and 2, which is late";
  EXPECT_NEAR(*figures.fused_500ms_share, 1.0 / 2, 1e-12);
}

TEST(LabFigures, WhatIsToldToAllIsAnAnswerToEachOfTheOthers) {
  const ExchangeLogs logs{
      {"a", {{1000, kAnswered, "*", 9}}}, {"b", {{1020, kFused, "a", 9}}}, {"c", {}}};
  LabFigures figures;
  judge_exchange(logs, figures);
  EXPECT_EQ(figures.answers, 2);
  EXPECT_EQ(figures.arrived_share, 0.5);
  EXPECT_EQ(figures.round_trip_ms, 20);
}

TEST(LabFigures, NothingSaidIsNoFigureRatherThanZero) {
  LabFigures figures;
  judge_exchange({{"a", {}}, {"b", {}}}, figures);
  EXPECT_EQ(figures.answers, 0);
  EXPECT_FALSE(figures.arrived_share);
  EXPECT_FALSE(figures.round_trip_ms);
}

TEST(LabFigures, ComeBackFromJsonAsTheyWere) {
  std::set<const char*> names;
  LabFigures figures;
  double value = 0;
  for (const LabFigureColumn& column : lab_figure_columns()) {
    figures.*column.figure = value += 0.5;
    names.insert(column.name);
  }
  figures.ate_m.reset();
  const LabFigures back = lab_figures_from_json(to_json(figures));
  for (const LabFigureColumn& column : lab_figure_columns()) {
    EXPECT_EQ(back.*column.figure, figures.*column.figure) << column.name;
  }
  EXPECT_EQ(names.size(), sizeof(LabFigures) / sizeof(LabFigures::Figure));
}

TEST(LabFigures, WireBytesAreThoseOfAllDronesPerDroneAndSecond) {
  LabFlightResult flight;
  flight.meeting = {PortCounts{10, 1000, 10, 0, 0, 0}, PortCounts{10, 3000, 10, 0, 0, 0}};
  flight.together = {PortCounts{8, 8000, 6, 2, 0, 0}, PortCounts{8, 4000, 5, 1, 1, 1}};
  flight.together_s = 2;
  flight.met_after_s = 0.4;
  const LabExperiment experiment;
  const LabFigures figures = judge({experiment, flight, {}, {}, {}, {}, {}});
  EXPECT_EQ(figures.met_after_s, 0.4);
  EXPECT_EQ(figures.meeting_bytes, 2000);
  EXPECT_EQ(figures.wire_bytes_per_s, 3000);
  EXPECT_EQ(figures.lost_share, 3.0 / 16);
  EXPECT_EQ(figures.queue_full_share, 1.0 / 16);
  EXPECT_EQ(figures.cut_share, 1.0 / 16);
  EXPECT_FALSE(figures.ate_m) << "nobody flew";
}

TEST(LabFigures, MemoryGrowsAsMuchAsThatOfTheDroneThatGrewMost) {
  std::vector<LabMemory> memory;
  for (int at_s = 0; at_s <= 200; ++at_s) {
    memory.push_back({"flat", double(at_s), at_s < 30 ? 20.0 + at_s : 50.0});
    memory.push_back({"growing", double(at_s), 40.0 + 0.02 * at_s});
  }
  const auto growth = memory_growth(memory);
  ASSERT_TRUE(growth.has_value());
  EXPECT_NEAR(*growth, 43.8 / 41.0 - 1, 1e-3);
  memory.erase(memory.begin() + 200, memory.end());
  EXPECT_FALSE(memory_growth(memory)) << "100 s say nothing";
}

TEST(LabFigures, AfterKillsOnlyTellHowTheyMetAgain) {
  LabFlightResult flight;
  flight.meeting.resize(2);
  flight.together.resize(2);
  flight.start_ms = 1000;
  flight.longest_silence_s = 0.4;
  flight.kills = {{"a", 3, 1.5}, {"b", 4, std::nullopt}, {"a", 8, 2.5}};
  const LabExperiment experiment;
  const ExchangeLogs logs{{"a", {{1000, kAsked, "*", 1}}}, {"b", {}}};
  const LabFigures figures = judge({experiment, flight, {}, logs, RunSummary(), RunSummary(), {}});
  EXPECT_EQ(figures.kills, 3);
  EXPECT_EQ(figures.met_again, 2);
  EXPECT_EQ(figures.met_again_median_s, 1.5);
  EXPECT_EQ(figures.met_again_max_s, 2.5);
  EXPECT_EQ(figures.longest_silence_s, 0.4);
  EXPECT_FALSE(figures.asked);
}

TEST(LabReport, ShowsEverySettingOnceAndAveragesItsSeeds) {
  std::vector<LabOutcome> outcomes;
  for (const double loss : {0.0, 0.3}) {
    for (const std::uint64_t seed : {1, 2}) {
      LabOutcome outcome;
      outcome.cell = {3, "lossy_wifi", "compact", {}, {}, seed, 1};
      outcome.cell.quality.loss = loss;
      outcome.figures.arrived_share = 1 - loss - 0.1 * static_cast<double>(seed);
      outcome.figures.ate_ratio = 0.5 + loss;
      outcomes.push_back(outcome);
    }
  }
  const std::string table = lab_table(outcomes);
  EXPECT_THAT(table, HasSubstr("arrived %"));
  EXPECT_THAT(table, HasSubstr("85.0"));
  EXPECT_THAT(table, HasSubstr("55.0"));
  EXPECT_EQ(std::count(table.begin(), table.end(), '\n'), 3);

  const TemporaryFolder folder;
  LabExperiment experiment;
  experiment.name = "<Loss>";
  write_lab_results(folder.path(), experiment, outcomes);
  const std::string page = content_of(folder.path() / "report.html");
  EXPECT_THAT(page, HasSubstr("&lt;Loss&gt;"));
  EXPECT_THAT(page, HasSubstr("<svg"));
  EXPECT_THAT(page, Not(HasSubstr("http://")));
  const std::string csv = content_of(folder.path() / "cells.csv");
  EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 5);
  const auto summary = nlohmann::json::parse(content_of(folder.path() / "summary.json"));
  EXPECT_EQ(summary["cells"].size(), 4U);
  EXPECT_EQ(summary["cells"][2]["loss"], 0.3);
}

}  // namespace
}  // namespace covey
