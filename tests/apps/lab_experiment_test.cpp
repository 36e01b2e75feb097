// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_experiment.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <set>

#include "apps/lab_flight.h"

namespace covey {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

LabExperiment read(const json& content) { return experiment_from_json(content, "e.json"); }

TEST(LabExperiment, FliesEveryCombinationSeedsLast) {
  const LabExperiment experiment = read({{"name", "n"},
                                         {"drones", 3},
                                         {"loss", {0, 0.3}},
                                         {"delay_ms", {20, 150}},
                                         {"rate_mbit", 6},
                                         {"jitter_ms", 5},
                                         {"seeds", {4, 5}},
                                         {"repeats", 2}});
  const std::vector<LabCell> cells = cells_of(experiment);
  ASSERT_EQ(cells.size(), 2U * 2 * 2 * 2);
  std::set<std::string> names;
  for (const LabCell& cell : cells) {
    names.insert(cell.name());
    EXPECT_EQ(cell.drones, 3);
    EXPECT_EQ(cell.quality.rate_bit_per_s, 6e6);
    EXPECT_EQ(cell.quality.jitter_s, 5e-3);
  }
  EXPECT_EQ(names.size(), cells.size()) << "each has a folder of its own";
  EXPECT_EQ(cells[0].quality.delay_s, 0.02);
  EXPECT_EQ(cells[1].quality.delay_s, 0.15);
  EXPECT_EQ(cells[3].seed, 4U);
  EXPECT_EQ(cells[4].seed, 5U);
  EXPECT_EQ(cells.front().name(), "lossy_wifi_compact_3drones_loss0_burst1_6mbit_20ms_seed4_run1");
}

TEST(LabExperiment, ReadsWhatTheLinksDo) {
  const LabExperiment experiment =
      read({{"name", "n"},
            {"links", {{{"from", "uav0"}, {"to", "uav1"}, {"loss", 0.5}, {"delay_ms", 10}}}},
            {"radio", {{"half_range_m", 30}}},
            {"partitions", {{{"from_s", 2}, {"until_s", 5}, {"apart", {"uav0", "uav2"}}}}},
            {"kills", {{"count", 3}}},
            {"variants",
             {{{"name", "few"}, {"config", {{"collaboration", {{"max_landmarks", 10}}}}}}}}});
  ASSERT_EQ(experiment.links.size(), 1U);
  EXPECT_EQ(experiment.links[0].quality.loss, 0.5);
  EXPECT_EQ(experiment.links[0].quality.delay_s, 0.01);
  EXPECT_EQ(experiment.range.half_range_m, 30);
  ASSERT_EQ(experiment.partitions.size(), 1U);
  EXPECT_EQ(experiment.partitions[0].apart, (std::vector<std::string>{"uav0", "uav2"}));
  EXPECT_EQ(experiment.kills.count, 3);
  EXPECT_EQ(cells_of(experiment).front().variant.name, "few");
}

TEST(LabExperiment, FlightsOfOneNameAreRefused) {
  const auto variant = [](const char* name, int pairs) {
    return json{{"name", name}, {"config", {{"link", {{"max_agents", pairs}}}}}};
  };
  for (const json& twice :
       {json{{"name", "n"}, {"variants", {variant("few", 3), variant("few", 4)}}},
        json{{"name", "n"}, {"loss", {0.1, 0.10000001}}}, json{{"name", "n"}, {"seeds", {3, 3}}}}) {
    EXPECT_THAT([&] { (void)read(twice); },
                ThrowsMessage<std::runtime_error>(
                    AllOf(HasSubstr("e.json: two flights would be named lossy_wifi_compact_"),
                          HasSubstr("name every variant differently"))));
  }
}

TEST(LabExperiment, EachVariantIsCheckedAsItIsFlown) {
  // Too few bytes for a datagram of lossy_wifi; the first one's profile has no such limit.
  const json small{{"link", {{"override", {{"load.drone_burst_bytes", 1200}}}}}};
  const json clean{{"link", {{"profile", "clean"}}}};
  const auto experiment = [](const json& first, const json& second) {
    return json{
        {"name", "n"},
        {"variants",
         {{{"name", "first"}, {"config", first}}, {{"name", "second"}, {"config", second}}}}};
  };
  EXPECT_NO_THROW((void)read(experiment(clean, clean)));
  EXPECT_THAT([&] { (void)read(experiment(clean, small)); },
              ThrowsMessage<std::runtime_error>(HasSubstr("drone_burst_bytes")));
}

struct Mistake {
  json content;
  const char* complaint;
};

TEST(LabExperiment, AMistakeIsOneLineThatNamesTheKey) {
  const json partition{{"from_s", 5}, {"until_s", 2}, {"apart", {"uav0"}}};
  const std::vector<Mistake> mistakes{
      {json::array(), "not a JSON object"},
      {json::object(), "'name' is missing"},
      {{{"name", 3}}, "'name' is not a text"},
      {{{"name", "n"}, {"los", 0.1}}, "unknown key 'los'"},
      {{{"name", "n"}, {"loss", 1.5}}, "'loss' is out of range (0 .. 0.99): 1.5"},
      {{{"name", "n"}, {"loss", {0.1, "a"}}}, "'loss' is not a number"},
      {{{"name", "n"}, {"loss", json::array()}}, "'loss' is empty"},
      {{{"name", "n"}, {"seeds", 0.5}}, "'seeds' is not a whole number"},
      {{{"name", "n"}, {"fly", 1}}, "'fly' is neither true nor false"},
      {{{"name", "n"}, {"exchanges", "loud"}}, "'exchanges' knows compact, paper and naive"},
      {{{"name", "n"}, {"profiles", "loud"}}, "'profiles': link.profile: no profile 'loud'"},
      {{{"name", "n"}, {"config", {{"estimator", {{"x", 1}}}}}}, "'config': unknown key"},
      {{{"name", "n"}, {"radio", 3}}, "'radio' is none"},
      {{{"name", "n"}, {"radio", json::object()}}, "'radio.half_range_m' is missing"},
      {{{"name", "n"}, {"kills", {{"count", 1}, {"x", 1}}}}, "unknown key 'kills.x'"},
      {{{"name", "n"}, {"partitions", {partition}}}, "'partitions.until_s' is not after"},
      {{{"name", "n"}, {"links", {{{"from", "uav0"}}}}}, "'links.to' is missing"},
      {{{"name", "n"}, {"variants", {{{"name", "v"}}}}}, "'variants.config' is missing"},
      {{{"name", "n"}, {"variants", {{{"name", "../v"}, {"config", json::object()}}}}},
       "'variants.name' is part of a folder's name"},
  };
  for (const Mistake& mistake : mistakes) {
    EXPECT_THAT([&] { (void)read(mistake.content); },
                ThrowsMessage<std::runtime_error>(
                    AllOf(HasSubstr("e.json"), HasSubstr(mistake.complaint))));
  }
}

TEST(LabExperiment, ShippedOnesAreRead) {
  int count = 0;
  for (const auto& file : std::filesystem::directory_iterator(COVEY_LAB_EXPERIMENTS)) {
    const LabExperiment experiment = read_experiment(file.path());
    EXPECT_FALSE(experiment.about.empty()) << file.path();
    EXPECT_FALSE(experiment.scenario.empty()) << file.path();
    EXPECT_FALSE(cells_of(experiment).empty()) << file.path();
    ++count;
  }
  EXPECT_GE(count, 5);
}

TEST(LabFlight, KillsComeInOrderAwayFromBothEndsAndAreTheSeeds) {
  LabKills kills;
  kills.count = 50;
  const std::vector<double> moments = kill_moments(kills, 20, 3);
  ASSERT_EQ(moments.size(), 50U);
  EXPECT_TRUE(std::is_sorted(moments.begin(), moments.end()));
  EXPECT_GE(moments.front(), 1);
  EXPECT_LE(moments.back(), 14);
  EXPECT_EQ(moments, kill_moments(kills, 20, 3));
  EXPECT_NE(moments, kill_moments(kills, 20, 4));
  EXPECT_TRUE(kill_moments(kills, 7, 3).empty()) << "too short a flight";
}

}  // namespace
}  // namespace covey
