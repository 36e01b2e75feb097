// SPDX-License-Identifier: Apache-2.0
#include "apps/link_profiles.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <stdexcept>

#include "apps/config_file.h"
#include "apps/config_json.h"
#include "apps/shipped_profiles.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

json shipped() { return json::parse(kShippedProfiles).at("profiles"); }

nlohmann::ordered_json values_of(LinkProfile profile) {
  return to_ordered_json([&](ConfigVisitor& visitor) { visit_profile(profile, visitor); });
}

std::string complaint_about(const ProfileChoice& choice) {
  try {
    (void)read_profile(choice, "drone.json: link");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "no complaint";
}

std::string complaint_about_override(const std::string& key, const std::string& value) {
  return complaint_about({"lossy_wifi", "", {{key, value}}});
}

class OwnProfiles : public testing::Test {
 protected:
  std::string file_with(const std::string& text) {
    return folder_.write("profiles.json", text).string();
  }

 private:
  TemporaryFolder folder_;
};

TEST(LinkProfiles, TheDefaultsOfTheProgramAreLossyWifi) {
  EXPECT_EQ(values_of(LinkProfile()), values_of(read_profile({}, "test")));
  EXPECT_EQ(ProfileChoice().name, "lossy_wifi");
}

TEST(LinkProfiles, EveryShippedProfileWorksAndEveryValueOfItHasItsReason) {
  for (const ProfileName& profile : profile_names("")) {
    EXPECT_FALSE(profile.why.empty()) << profile.name;
    const ProfileChoice choice{profile.name, "", {}};
    const auto sections = profile_with_reasons(choice, "test");
    for (const auto& [section, values] : sections.items()) {
      for (const auto& [key, value] : values.items())
        EXPECT_NE(value.at("why"), "") << profile.name << " " << section << "." << key;
    }
  }
}

// A value that is changed brings a reason of its own; a reason without a value is a leftover.
TEST(LinkProfiles, EachShippedSectionHasAsManyReasonsAsValues) {
  const json profiles = shipped();
  for (const auto& [name, profile] : profiles.items()) {
    for (const auto& [section, values] : profile.items()) {
      if (!values.is_object()) continue;
      for (const auto& [key, value] : values.items()) {
        if (key == "why") continue;
        EXPECT_TRUE(values.at("why").contains(key)) << name << "." << section << "." << key;
      }
      EXPECT_EQ(values.size() - 1, values.at("why").size()) << name << "." << section;
    }
  }
}

TEST(LinkProfiles, TheProfileThatOthersAreMadeFromSaysEverything) {
  json base = shipped().at("lossy_wifi");
  base.erase("why");
  for (json& section : base) section.erase("why");
  EXPECT_EQ(base, json(values_of(LinkProfile())));
}

TEST(LinkProfiles, LockstepLosesNothingAndHurriesNobody) {
  const LinkProfile profile = read_profile({"lockstep", "", {}}, "test");
  for (const TopicProfile& topic : {profile.request, profile.message, profile.full_message}) {
    EXPECT_EQ(topic.reliability, Reliability::kReliable);
    EXPECT_EQ(topic.history, History::kAll);
    EXPECT_EQ(topic.lifespan_ms, 0);
    EXPECT_EQ(topic.flow_bytes, 0);
  }
  EXPECT_EQ(profile.load.drone_bytes_per_s, 0);
  EXPECT_EQ(profile.load.link_bytes_per_s, 0);
  EXPECT_GT(profile.discovery.farewell_ms, 0);
}

TEST(LinkProfiles, SingleValuesAreOverridden) {
  const ProfileChoice choice{
      "narrowband", "", {{"message.heartbeat_ms", "123"}, {"discovery.mode", "\"multicast\""}}};
  const LinkProfile profile = read_profile(choice, "test");
  EXPECT_EQ(profile.message.heartbeat_ms, 123);
  EXPECT_EQ(profile.discovery.mode, DiscoveryMode::kMulticast);
  EXPECT_EQ(profile.request.heartbeat_ms, 400);  // narrowband's own
  const auto reasons = profile_with_reasons(choice, "uav0.json");
  EXPECT_EQ(reasons["message"]["heartbeat_ms"]["why"], "overridden by uav0.json");
}

TEST(LinkProfiles, AnUnknownProfileIsNamedWithThoseThereAre) {
  EXPECT_THAT(complaint_about({"wifi", "", {}}),
              AllOf(HasSubstr("drone.json: link.profile: no profile 'wifi'"),
                    HasSubstr("lossy_wifi"), HasSubstr("narrowband")));
}

TEST(LinkProfiles, AnOverrideThatCannotBeIsNamed) {
  EXPECT_THAT(complaint_about_override("message.hartbeat_ms", "40"),
              AllOf(HasSubstr("drone.json: link.override: unknown key 'message.hartbeat_ms'"),
                    HasSubstr("heartbeat_ms")));
  EXPECT_THAT(complaint_about_override("mesage.heartbeat_ms", "40"),
              HasSubstr("unknown key 'mesage'"));
  EXPECT_THAT(complaint_about_override("heartbeat_ms", "40"),
              HasSubstr("'heartbeat_ms' names no section: write it as message.heartbeat_ms"));
  EXPECT_THAT(complaint_about_override("message.heartbeat_ms", "-1"),
              HasSubstr("'message.heartbeat_ms' is out of range (1 .. 100000): -1"));
  EXPECT_THAT(complaint_about_override("message.reliability", "\"mostly\""),
              HasSubstr("'message.reliability' is none of best_effort, reliable: \"mostly\""));
}

TEST(LinkProfiles, ValuesThatContradictEachOtherAreRefused) {
  EXPECT_THAT(complaint_about_override("request.lifespan_ms", "30"),
              HasSubstr("request.lifespan_ms is not above heartbeat_ms"));
  EXPECT_THAT(complaint_about_override("message.flow_bytes", "300"),
              HasSubstr("message.flow_bytes is below 512"));
  EXPECT_THAT(complaint_about_override("status.reliability", "\"best_effort\""),
              HasSubstr("status must be reliable"));
  EXPECT_THAT(complaint_about_override("odometry.history", "\"all\""),
              HasSubstr("odometry.history all needs reliability"));
  EXPECT_THAT(complaint_about_override("discovery.lease_ms", "1500"),
              HasSubstr("discovery.lease_ms is below twice announcement_ms"));
  EXPECT_THAT(complaint_about_override("discovery.sign_of_life_ms", "1900"),
              HasSubstr("discovery.sign_of_life_ms is not below status.liveliness_ms"));
  EXPECT_THAT(complaint_about_override("load.link_burst_bytes", "10"),
              HasSubstr("load.link_burst_bytes is below transport.datagram_bytes"));
}

TEST_F(OwnProfiles, AreMadeFromEachOther) {
  const std::string file = file_with(R"({"profiles": {
    "slow": {"request": {"heartbeat_ms": 90, "depth": 3}},
    "slower": {"from": "slow", "request": {"heartbeat_ms": 150}}}})");
  const LinkProfile profile = read_profile({"slower", file, {}}, "test");
  EXPECT_EQ(profile.request.heartbeat_ms, 150);
  EXPECT_EQ(profile.request.depth, 3);
  EXPECT_EQ(profile.message.depth, LinkProfile().message.depth);
}

TEST_F(OwnProfiles, ThatAreMalformedAreNamed) {
  const auto complaint = [&](const std::string& text) {
    return complaint_about({"mine", file_with(text), {}});
  };
  EXPECT_THAT(complaint("{"), AllOf(HasSubstr("profiles.json"), HasSubstr("not valid JSON")));
  EXPECT_THAT(complaint("[]"), HasSubstr("holds no profiles"));
  EXPECT_THAT(complaint(R"({"profiles": {"mine": {"from": "mine"}}})"),
              HasSubstr("'mine' is made from itself"));
  EXPECT_THAT(complaint(R"({"profiles": {"mine": {"from": 3}}})"),
              HasSubstr("'mine.from' is not a profile's name"));
  EXPECT_THAT(complaint(R"({"profiles": {"mine": {"request": {"dept": 3}}}})"),
              AllOf(HasSubstr("profiles.json: mine"), HasSubstr("unknown key 'request.dept'")));
  EXPECT_THAT(complaint(R"({"profiles": {"mine": {"request": 3}}})"),
              HasSubstr("'request' is not a section"));
  EXPECT_THAT(complaint_about({"mine", "/nowhere/profiles.json", {}}),
              HasSubstr("/nowhere/profiles.json: the profiles cannot be read"));
}

TEST_F(OwnProfiles, AReasonThatIsNoTextIsNamed) {
  const std::string profile = file_with(R"({"profiles": {"mine": {"why": 3}}})");
  EXPECT_THAT([&] { (void)profile_names(profile); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("profiles.json"), HasSubstr("'mine/why' is no text"))));
  const std::string value =
      file_with(R"({"profiles": {"mine": {"request": {"depth": 3, "why": {"depth": ["much"]}}}}})");
  EXPECT_THAT(
      [&] {
        (void)profile_with_reasons({"mine", value, {}}, "test");
      },
      ThrowsMessage<std::runtime_error>(
          AllOf(HasSubstr("profiles.json"), HasSubstr("'mine/request/why/depth' is no"))));
}

TEST(LinkProfiles, AConfigurationChoosesAndOverrides) {
  AgentConfig config;
  merge_config(
      {{"link", {{"profile", "clean"}, {"override", {{"message.depth", 9}}}, {"team", "blue"}}}},
      "drone.json", config);
  EXPECT_EQ(config.link.profile.message.depth, 9);
  EXPECT_EQ(config.link.profile.load.drone_bytes_per_s, 0);
  AgentConfig again;
  merge_config(json::parse(print_config(config)), "printed.json", again);
  EXPECT_EQ(print_config(again), print_config(config));
  EXPECT_EQ(again.link.profile.message.depth, 9);
  EXPECT_THROW(merge_config({{"link", {{"override", {{"message.depht", 9}}}}}}, "d", config),
               std::runtime_error);
  EXPECT_THROW(merge_config({{"link", {{"override", 3}}}}, "d", config), std::runtime_error);
}

}  // namespace
}  // namespace covey
