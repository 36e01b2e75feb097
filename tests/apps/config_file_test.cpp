// SPDX-License-Identifier: Apache-2.0
#include "apps/config_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <stdexcept>
#include <string>

namespace covey {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

AgentConfig merged(const json& settings) {
  AgentConfig config;
  merge_config(settings, "drone.json", config);
  return config;
}

std::string complaint_about(const json& settings) {
  try {
    (void)merged(settings);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "no complaint";
}

TEST(ConfigFile, KeysThatAreNotGivenKeepTheirDefaults) {
  const AgentConfig config = merged({{"tracker", {{"max_tracks", 77}}}});
  EXPECT_EQ(config.tracker.max_tracks, 77);
  EXPECT_EQ(config.tracker.pixel_sigma, TrackerConfig().pixel_sigma);
  EXPECT_EQ(config.estimator.max_clones, EstimatorConfig().max_clones);
}

TEST(ConfigFile, WhatIsPrintedReadsBackAsTheSame) {
  AgentConfig config;
  config.agent.name = "uav7";
  config.agent.pace = Pace::kRate;
  config.collaboration.keyframe.rotation = 0.123456789;
  config.link.initial_peers = {"10.0.0.1", "10.0.0.2"};
  const std::string printed = print_config(config);
  EXPECT_EQ(print_config(merged(json::parse(printed))), printed);
}

TEST(ConfigFile, DegreesInTheFileAreRadiansInTheProgram) {
  const AgentConfig config = merged({{"initialisation", {{"yaw_deg", 90}}}});
  EXPECT_NEAR(config.initialisation.yaw, M_PI / 2, 1e-12);
}

TEST(ConfigFile, ThePrintedAnglesAreUnchangedByReadingThemBack) {
  const AgentConfig before;
  const AgentConfig after = merged(json::parse(print_config(before)));
  EXPECT_EQ(after.collaboration.keyframe.rotation, before.collaboration.keyframe.rotation);
  EXPECT_EQ(after.initialisation.tilt_sigma, before.initialisation.tilt_sigma);
}

TEST(ConfigFile, AnUnknownKeyIsNamedWithItsSectionAndFile) {
  EXPECT_THAT(complaint_about({{"tracker", {{"max_track", 77}}}}),
              AllOf(HasSubstr("drone.json"), HasSubstr("unknown key 'tracker.max_track'"),
                    HasSubstr("max_tracks")));
}

TEST(ConfigFile, AnUnknownSectionIsNamed) {
  EXPECT_THAT(complaint_about({{"traker", json::object()}}), HasSubstr("unknown key 'traker'"));
}

TEST(ConfigFile, AValueOfAnotherTypeIsNamed) {
  EXPECT_THAT(complaint_about({{"tracker", {{"max_tracks", "many"}}}}),
              HasSubstr("'tracker.max_tracks' is not a whole number: \"many\""));
  EXPECT_THAT(complaint_about({{"tracker", {{"max_tracks", 1.5}}}}),
              HasSubstr("'tracker.max_tracks' is not a whole number: 1.5"));
  EXPECT_THAT(complaint_about({{"estimator", {{"gravity", true}}}}),
              HasSubstr("'estimator.gravity' is not a number: true"));
  EXPECT_THAT(complaint_about({{"estimator", {{"zero_velocity_updates", 1}}}}),
              HasSubstr("'estimator.zero_velocity_updates' is neither true nor false"));
  EXPECT_THAT(complaint_about({{"link", {{"initial_peers", {1, 2}}}}}),
              HasSubstr("'link.initial_peers' is not a list of texts"));
  EXPECT_THAT(complaint_about({{"agent", 3}}), HasSubstr("'agent' is not a section"));
  EXPECT_THAT(complaint_about(json::array()), HasSubstr("not a JSON object"));
}

TEST(ConfigFile, AValueOutOfRangeIsNamedWithTheRange) {
  EXPECT_THAT(complaint_about({{"estimator", {{"max_clones", -1}}}}),
              AllOf(HasSubstr("'estimator.max_clones' is out of range"), HasSubstr("-1")));
  EXPECT_THAT(complaint_about({{"estimator", {{"gravity", 1e9}}}}), HasSubstr("out of range"));
}

TEST(ConfigFile, AnUnknownChoiceIsNamedWithTheKnownOnes) {
  EXPECT_THAT(complaint_about({{"agent", {{"pace", "slow"}}}}),
              HasSubstr("'agent.pace' is none of max, lockstep, rate, live: \"slow\""));
}

TEST(ConfigFile, AFailedMergeChangesNothing) {
  AgentConfig config;
  const json settings = {{"tracker", {{"max_tracks", 77}}}, {"zzz", 1}};
  EXPECT_THROW(merge_config(settings, "drone.json", config), std::runtime_error);
  EXPECT_EQ(config.tracker.max_tracks, TrackerConfig().max_tracks);
}

TEST(ConfigFile, BrokenJsonAndMissingFilesAreNamed) {
  const std::string file = testing::TempDir() + "broken_config.json";
  std::ofstream(file) << "{ \"agent\": ";
  EXPECT_THAT([&] { (void)read_config(file); }, testing::ThrowsMessage<std::runtime_error>(AllOf(
                                                    HasSubstr(file), HasSubstr("not valid JSON"))));
  EXPECT_THAT([] { (void)read_config("/tmp"); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("/tmp: cannot be read: it is")));
  EXPECT_THAT([] { (void)read_config("/nowhere/config.json"); },
              testing::ThrowsMessage<std::runtime_error>(HasSubstr("/nowhere/config.json")));
}

TEST(ConfigFile, AKeyThatStandsTwiceIsNamed) {
  const std::string file = testing::TempDir() + "twofold_config.json";
  std::ofstream(file) << R"({"link": {"domain": 1}, "agent": {"name": "a", "domain": 1},
                             "tracker": {"max_tracks": 9, "max_tracks": 90}})";
  EXPECT_THAT([&] { (void)read_config(file); },
              testing::ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(file), HasSubstr("key \"max_tracks\" stands twice"))));
}

TEST(ConfigFile, AFileThatIsNestedDeepIsNamed) {
  const std::string file = testing::TempDir() + "deep_config.json";
  const std::size_t levels = 200'000;
  std::ofstream(file) << R"({"agent": {"name": )" << std::string(levels, '[')
                      << std::string(levels, ']') << "}}";
  EXPECT_THAT([&] { (void)read_config(file); },
              testing::ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr(file), HasSubstr("nested deeper than 32 levels"))));
}

TEST(ConfigFile, EveryPrintedKeyIsDescribed) {
  const json printed = json::parse(print_config(AgentConfig()));
  const std::string description = describe_config();
  for (const auto& [section, keys] : printed.items()) {
    for (const auto& [key, value] : keys.items()) {
      EXPECT_THAT(description, HasSubstr(std::string(section).append(".").append(key).append(" ")))
          << value;
    }
  }
}

TEST(ConfigFile, NoKeyStandsTwice) {
  std::istringstream description(describe_config());
  std::set<std::string> seen;
  for (std::string line; std::getline(description, line);) {
    const std::string key = line.substr(0, line.find(' '));
    if (key.empty()) continue;
    EXPECT_TRUE(seen.insert(key).second) << key;
  }
  EXPECT_GT(seen.size(), 100u);
}

TEST(ConfigFile, KeysThatHoldAnglesEndInDeg) {
  std::istringstream description(describe_config());
  for (std::string line; std::getline(description, line);) {
    const bool in_degrees = line.find("[deg]") != std::string::npos;
    const std::string key = line.substr(0, line.find(' '));
    EXPECT_EQ(in_degrees, key.size() > 4 && key.substr(key.size() - 4) == "_deg") << line;
  }
}

TEST(AgentConfig, AWorldOfItsOwnIsNoCommonStart) {
  AgentConfig config;
  EXPECT_NO_THROW(require_possible(config));
  config.initialisation.own_world = true;
  EXPECT_THAT([&] { require_possible(config); },
              ThrowsMessage<std::runtime_error>(AllOf(HasSubstr("initialisation.own_world"),
                                                      HasSubstr("fusion.common_start to false"))));
  config.fusion.drift.common_start = false;
  EXPECT_NO_THROW(require_possible(config));
  config.fusion.mode = FusionMode::kIntersectedState;
  EXPECT_THAT([&] { require_possible(config); },
              ThrowsMessage<std::runtime_error>(HasSubstr("needs fusion.mode joint")));
}

TEST(AgentConfig, TheLeastIsBelowTheMost) {
  AgentConfig config = merged({{"estimator", {{"min_depth_m", 1000}, {"max_depth_m", 1}}}});
  EXPECT_THAT([&] { require_possible(config); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("estimator.min_depth_m"), HasSubstr("estimator.max_depth_m"))));
  config = merged({{"tracker", {{"outlier_min_epipolar_px", 9}, {"outlier_max_epipolar_px", 8}}}});
  EXPECT_THAT([&] { require_possible(config); },
              ThrowsMessage<std::runtime_error>(HasSubstr("tracker.outlier_min_epipolar_px")));
}

TEST(AgentConfig, TheTrackerTakesWhatItsRangesSay) {
  CameraIntrinsics camera;
  camera.width = 640, camera.height = 480;
  camera.fx = camera.fy = 400;
  for (const int levels : {1, 6}) {
    for (const int lag : {2, 15}) {
      const AgentConfig config =
          merged({{"tracker", {{"pyramid_levels", levels}, {"outlier_max_lag", lag}}}});
      EXPECT_NO_THROW(Tracker(config.tracker, camera));
    }
  }
  for (const int levels : {0, 7})
    EXPECT_THAT(complaint_about({{"tracker", {{"pyramid_levels", levels}}}}),
                HasSubstr("tracker.pyramid_levels"));
  for (const int lag : {1, 16})
    EXPECT_THAT(complaint_about({{"tracker", {{"outlier_max_lag", lag}}}}),
                HasSubstr("tracker.outlier_max_lag"));
}

TEST(AgentConfig, NobodyWaitsForMoreThanATeamMayBe) {
  EXPECT_THAT(complaint_about({{"link", {{"max_agents", kMaxAgents + 1}}}}),
              HasSubstr("link.max_agents"));
  EXPECT_THAT(complaint_about({{"agent", {{"wait_for_peers", kMaxAgents}}}}),
              HasSubstr("agent.wait_for_peers"));
  AgentConfig config = merged({{"agent", {{"wait_for_peers", 16}}}});
  EXPECT_THAT([&] { require_possible(config); },
              ThrowsMessage<std::runtime_error>(HasSubstr("link.max_agents of 16")));
  config.link.max_agents = 17;
  EXPECT_NO_THROW(require_possible(config));
}

TEST(AgentConfig, ALiveFlightHasNoGroundTruthToStartFrom) {
  AgentConfig config;
  config.agent.pace = Pace::kLive;
  config.initialisation.method = InitMethod::kGroundTruth;
  EXPECT_THAT([&] { require_possible(config); },
              ThrowsMessage<std::runtime_error>(HasSubstr("initialisation.method to static")));
  config.initialisation.method = InitMethod::kStatic;
  EXPECT_NO_THROW(require_possible(config));
}

TEST(AgentConfig, RadioAndSensorsAreNotHeardAtOneAddress) {
  AgentConfig config;
  config.agent.pace = Pace::kLive;
  config.initialisation.method = InitMethod::kStatic;
  config.onboard.loopback_only = config.link.loopback_only = false;
  EXPECT_THAT([&] { require_possible(config); },
              ThrowsMessage<std::runtime_error>(HasSubstr("onboard.domain and link.domain")));
  config.onboard.loopback_only = true;
  EXPECT_NO_THROW(require_possible(config));
  config.onboard.loopback_only = false;
  config.onboard.domain = 1;
  EXPECT_NO_THROW(require_possible(config));
}

TEST(AgentConfig, WithoutACommonStartPeersMayBeAnywhere) {
  AgentConfig config;
  const VerificationConfig near = collaborator_config(config, true).matching.verification;
  EXPECT_EQ(near.max_offset, config.collaboration.matching.verification.max_offset);
  config.fusion.drift.common_start = false;
  const CollaboratorConfig lost = collaborator_config(config, true);
  EXPECT_FALSE(lost.matching.common_start);
  EXPECT_GE(lost.matching.verification.max_offset, 1e6);
  EXPECT_GE(lost.matching.verification.max_yaw, M_PI);
}

TEST(AgentConfig, MeasuredStartsMayBeAsWrongAsTheyAreSaidToBe) {
  AgentConfig config;
  config.fusion.start_position_sigma_m = 1;
  config.fusion.start_yaw_sigma = 0.1;
  const KeyframeMatcherConfig exact = collaborator_config(config, true).matching;
  const KeyframeMatcherConfig measured = collaborator_config(config, false).matching;
  EXPECT_EQ(exact.start_position_sigma, 0);
  EXPECT_EQ(exact.start_yaw_sigma, 0);
  EXPECT_EQ(measured.start_position_sigma, 1);
  EXPECT_EQ(measured.start_yaw_sigma, 0.1);
}

TEST(AgentConfig, StartsAreExactWhereGroundTruthTellsThem) {
  FusionConfig fusion;
  const auto sigma_m = [&](bool has_truth) {
    return drift_config(fusion, has_truth).start_position_sigma_m;
  };
  EXPECT_EQ(sigma_m(true), 0);
  EXPECT_EQ(sigma_m(false), fusion.start_position_sigma_m);
  EXPECT_EQ(drift_config(fusion, false).start_yaw_sigma, fusion.start_yaw_sigma);
  fusion.starts = KnownStarts::kMeasured;
  EXPECT_EQ(sigma_m(true), fusion.start_position_sigma_m);
  fusion.starts = KnownStarts::kExact;
  EXPECT_EQ(sigma_m(false), 0);
}

}  // namespace
}  // namespace covey
