// SPDX-License-Identifier: Apache-2.0
#include "comms/peer_link.h"

#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <functional>
#include <iterator>
#include <map>
#include <optional>
#include <stdexcept>
#include <thread>
#include <variant>
#include <vector>

#include "comms/config_check.h"
#include "comms/convert.h"
#include "tests/comms/samples.h"
#include "tests/comms/taken_port.h"
#include "tests/comms/team_config.h"

namespace covey {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::UnorderedElementsAre;

LinkConfig lockstep_config(const std::string& agent) {
  LinkConfig config = team_config(agent);
  config.profile = lossless_profile();
  return config;
}

template <typename Message>
std::vector<Message> taken(PeerLink& link) {
  std::vector<Message> out;
  for (Inbound& inbound : link.take())
    if (auto* message = std::get_if<Message>(&inbound)) out.push_back(std::move(*message));
  return out;
}

// The reason why a link with this configuration cannot be made.
std::string complaint(const std::function<void(LinkConfig&)>& damage) {
  LinkConfig config = team_config("uav0");
  damage(config);
  try {
    const PeerLink link(config);
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

TEST(PeerLink, AConfigurationThatCannotWorkIsRefusedByName) {
  EXPECT_THAT(complaint([](auto& c) { c.agent = ""; }), HasSubstr("agent"));
  EXPECT_THAT(complaint([](auto& c) { c.agent = "a/b"; }), HasSubstr("a/b"));
  EXPECT_THAT(complaint([](auto& c) { c.team = "two words"; }), HasSubstr("two words"));
  EXPECT_THAT(complaint([](auto& c) { c.domain = 201; }), HasSubstr("domain 201 is not in 0..200"));
  EXPECT_THAT(complaint([](auto& c) { c.max_agents = 1; }), HasSubstr("max_agents 1"));
  EXPECT_THAT(complaint([](auto& c) { c.team_size = c.max_agents + 1; }), HasSubstr("team_size"));
  EXPECT_THAT(complaint([](auto& c) { c.inbox_limit = 0; }), HasSubstr("inbox_limit"));
  EXPECT_THAT(complaint([](auto& c) {
                c.loopback_only = false;
                c.interfaces = {"localhost"};  // a name
                c.initial_peers = {"127.0.0.1"};
              }),
              HasSubstr("localhost"));
  EXPECT_THAT(complaint([](auto& c) {
                c.loopback_only = false;
                c.interfaces = {"127.0.0.1"};
                c.initial_peers = {"uav1.local"};
              }),
              HasSubstr("uav1.local"));
  EXPECT_THAT(complaint([](auto& c) {
                c.loopback_only = false;
                c.interfaces = {"192.0.2.1"};  // never assigned (RFC 5737)
                c.initial_peers = {"127.0.0.1"};
              }),
              HasSubstr("no address of this machine, which has: 127.0.0.1"));
}

TEST(PeerLink, DiscoveryThatCouldFindNobodyIsRefused) {
  EXPECT_THAT(complaint([](auto& c) {
                c.loopback_only = false;
                c.interfaces = {"127.0.0.1"};
              }),
              HasSubstr("initial_peers is empty: list the addresses of the other drones"));
  EXPECT_THAT(complaint([](auto& c) {
                c.loopback_only = false;
                c.interfaces = {"127.0.0.1"};
                c.initial_peers = {"127.0.0.1"};
                c.profile.discovery.mode = DiscoveryMode::kMulticast;
              }),
              HasSubstr("initial_peers are of no use with discovery.mode multicast"));
  for (const char* server : {"", "127.0.0.1", "127.0.0.1:0", "127.0.0.1:1x", "base:11811"}) {
    EXPECT_THAT(complaint([&](auto& c) {
                  c.profile.discovery.mode = DiscoveryMode::kServer;
                  c.discovery_server = server;
                }),
                HasSubstr("discovery_server"));
  }
}

TEST(PeerLink, AnImpossibleProfileIsRefused) {
  EXPECT_THAT(complaint([](auto& c) { c.profile.request.depth = 0; }),
              HasSubstr("link profile: request.depth is 0"));
}

// Values are rounded on their way.
PeerKeyframe as_it_arrives(const PeerKeyframe& keyframe) {
  return std::get<PeerKeyframe>(decode_peer_keyframe(encode(keyframe)));
}

// Twenty answers at once where there is room for a few: the first find it, of the others the one
// that shows most is next. It all arrives as it was sent; the rest is dropped and counted.
TEST(PeerLink, ASaturatedLinkSendsWhatIsMostUsefulAndCountsTheRest) {
  LinkConfig narrow = team_config("uav0");
  narrow.profile.load = {250'000, 64'000, 4000, 12'000, 1500};
  PeerLink sender(narrow), receiver(team_config("uav1"));
  ASSERT_TRUE(sender.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(receiver.wait_for_peers({"uav0"}, kPatience));
  constexpr std::uint64_t kFirst = 10, kCount = 20, kShowsMost = 23;  // of one size
  std::map<std::uint64_t, Bytes> offered;
  for (std::uint64_t i = kFirst; i < kFirst + kCount; ++i) {
    PeerKeyframe keyframe = samples::keyframe("uav0", "uav1", 95);
    keyframe.pose.keyframe_id = i;
    for (PeerLandmark& landmark : keyframe.landmarks)
      landmark.inverse_depth_sigma = (i == kShowsMost ? 0.02 : 0.2) * landmark.inverse_depth;
    offered[i] = encode(as_it_arrives(keyframe));
    ASSERT_TRUE(sender.send(keyframe));
  }
  const auto settled = [&] {
    const LinkStatistics now = sender.statistics();
    std::uint64_t dropped = 0;
    for (const auto& [reason, count] : now.dropped) dropped += count;
    return now.message.sent + dropped == kCount;
  };
  const auto start = std::chrono::steady_clock::now();
  while (!settled() && std::chrono::steady_clock::now() - start < kPatience)
    std::this_thread::yield();
  const LinkStatistics statistics = sender.statistics();
  EXPECT_TRUE(settled());
  EXPECT_GE(statistics.dropped.at("message found no room in time"), 10u);
  ASSERT_TRUE(receiver.wait_for_inbox({0, statistics.message.sent}, kPatience));
  std::vector<std::uint64_t> arrived;
  for (const Inbound& inbound : receiver.take()) {
    const auto* keyframe = std::get_if<PeerKeyframe>(&inbound);
    if (keyframe == nullptr) continue;  // a status
    arrived.push_back(keyframe->pose.keyframe_id);
    EXPECT_EQ(encode(*keyframe), offered.at(arrived.back())) << arrived.back();
  }
  ASSERT_EQ(arrived.size(), statistics.message.sent);
  const auto overtakes =
      std::adjacent_find(arrived.begin(), arrived.end(), [](auto a, auto b) { return b != a + 1; });
  ASSERT_NE(overtakes, arrived.end());
  EXPECT_GE(overtakes - arrived.begin(), 3) << "a burst goes at once";
  EXPECT_EQ(*std::next(overtakes), kShowsMost);
}

TEST(PeerLink, ADiscoveryServerFromTheEnvironmentIsRefused) {
  setenv("ROS_DISCOVERY_SERVER", "127.0.0.1:11811", 1);
  EXPECT_THAT(complaint([](auto&) {}), HasSubstr("ROS_DISCOVERY_SERVER"));
  unsetenv("ROS_DISCOVERY_SERVER");
}

// Drones have the names and numbers that people give them, also beyond 127.
TEST(PeerLink, ARequestReachesEverybodyAndItsAnswerOnlyTheAsker) {
  PeerLink asker(team_config("uav0")), other(team_config("Red_Kite-300")),
      third(team_config("200"));
  ASSERT_TRUE(asker.wait_for_peers({"Red_Kite-300", "200"}, kPatience));
  ASSERT_TRUE(other.wait_for_peers({"uav0", "200"}, kPatience));
  ASSERT_TRUE(third.wait_for_peers({"uav0", "Red_Kite-300"}, kPatience));

  const PlaceAdvert advert = samples::advert("uav0", 5);
  ASSERT_TRUE(asker.send(advert));
  ASSERT_TRUE(other.wait_for_inbox({1, 0}, kPatience));
  ASSERT_TRUE(third.wait_for_inbox({1, 0}, kPatience));
  const auto heard = taken<PlaceAdvert>(other);
  ASSERT_EQ(heard.size(), 1u);
  EXPECT_EQ(heard[0].descriptor, advert.descriptor);

  PeerKeyframe answer = samples::keyframe("Red_Kite-300", "uav0");
  answer.request_keyframe_id = heard[0].keyframe_id;
  ASSERT_TRUE(other.send(answer));
  ASSERT_TRUE(asker.wait_for_inbox({0, 1}, kPatience));
  const auto answers = taken<PeerKeyframe>(asker);
  ASSERT_EQ(answers.size(), 1u);
  EXPECT_EQ(answers[0].request_keyframe_id, 5u);
  EXPECT_EQ(answers[0].landmarks.size(), answer.landmarks.size());

  // Another request that the third one hears: what was sent before it would have arrived.
  ASSERT_TRUE(other.send(samples::advert("Red_Kite-300", 6)));
  ASSERT_TRUE(third.wait_for_inbox({2, 0}, kPatience));
  EXPECT_EQ(third.arrived().messages, 0u);
  ASSERT_TRUE(asker.wait_for_inbox({1, 0}, kPatience));
  EXPECT_EQ(asker.arrived().requests, 1u);  // its own is not among them
}

TEST(PeerLink, StatisticsAgreeOnBothSides) {
  PeerLink a(team_config("uav0")), b(team_config("uav1"));
  ASSERT_TRUE(a.wait_for_peers(1, kPatience));
  const PlaceAdvert advert = samples::advert("uav0");
  const PeerKeyframe keyframe = samples::keyframe("uav0", "uav1");
  ASSERT_TRUE(a.send(advert));
  ASSERT_TRUE(a.send(keyframe));
  ASSERT_TRUE(b.wait_for_inbox({1, 1}, kPatience));
  const LinkStatistics sent = a.statistics(), received = b.statistics();
  EXPECT_EQ(sent.request.sent, 1u);
  EXPECT_EQ(sent.request.payload_bytes_sent, encode(advert).size());
  EXPECT_EQ(received.request.received, 1u);
  EXPECT_EQ(received.request.payload_bytes_received, sent.request.payload_bytes_sent);
  EXPECT_EQ(sent.message.payload_bytes_sent, encode(keyframe).size());
  EXPECT_EQ(received.message.payload_bytes_received, sent.message.payload_bytes_sent);
  EXPECT_THAT(sent.messages_sent_to, ElementsAre(std::pair("uav1", 1u)));
  EXPECT_THAT(received.rejected, IsEmpty());
  const std::uint64_t payload = sent.request.payload_bytes_sent + sent.message.payload_bytes_sent;
  EXPECT_GT(sent.wire_bytes_sent, payload);
  EXPECT_GT(received.wire_bytes_received, payload);
  EXPECT_LT(received.wire_bytes_received, 20 * payload);
}

TEST(PeerLink, WhatOthersWouldRefuseIsNotSent) {
  PeerLink link(team_config("uav0"));
  EXPECT_FALSE(link.send(samples::advert("uav1")));
  PlaceAdvert long_one = samples::advert("uav0");
  long_one.descriptor.resize(4097);
  EXPECT_FALSE(link.send(long_one));
  EXPECT_FALSE(link.send(samples::keyframe("uav0", "nobody")));
  Odometry broken = samples::odometry();
  broken.pose.q_world_imu.coeffs().setZero();
  EXPECT_FALSE(link.publish(broken));
  const LinkStatistics statistics = link.statistics();
  EXPECT_EQ(statistics.request.sent, 0u);
  EXPECT_EQ(statistics.request.refused, 2u);
  EXPECT_EQ(statistics.message.refused, 1u);
  EXPECT_EQ(statistics.odometry.refused, 1u);
  EXPECT_EQ(statistics.refused.at("sender is not this drone"), 1u);
  EXPECT_EQ(statistics.refused.at("receiver is not there"), 1u);
}

TEST(PeerLink, ALateJoinerLearnsEveryStatusButNoOldRequest) {
  PeerLink first(team_config("uav0")), second(team_config("uav1"));
  ASSERT_TRUE(first.wait_for_peers(1, kPatience));
  ASSERT_TRUE(first.publish(samples::status("uav0", 111)));
  ASSERT_TRUE(second.publish(samples::status("uav1", 222)));
  ASSERT_TRUE(first.send(samples::advert("uav0", 1)));
  ASSERT_TRUE(second.wait_for_inbox({1, 0}, kPatience));

  PeerLink late(team_config("uav2"));
  ASSERT_TRUE(late.wait_for_peers({"uav0", "uav1"}, kPatience));
  std::map<std::string, std::uint32_t> frames;
  for (const AgentStatus& status : taken<AgentStatus>(late)) frames[status.agent] = status.frames;
  EXPECT_EQ(frames["uav0"], 111u);
  EXPECT_EQ(frames["uav1"], 222u);

  ASSERT_TRUE(first.wait_for_peers({"uav2"}, kPatience));
  ASSERT_TRUE(first.send(samples::advert("uav0", 2)));
  ASSERT_TRUE(late.wait_for_inbox({1, 0}, kPatience));
  const auto adverts = taken<PlaceAdvert>(late);
  ASSERT_EQ(adverts.size(), 1u);
  EXPECT_EQ(adverts[0].keyframe_id, 2u);
}

TEST(PeerLink, AFullInboxDropsTheOldestAndCounts) {
  LinkConfig small = lockstep_config("uav0");
  small.inbox_limit = 4;
  PeerLink reader(small), writer(lockstep_config("uav1"));
  ASSERT_TRUE(writer.wait_for_peers({"uav0"}, kPatience));
  for (std::uint64_t i = 0; i < 50; ++i) ASSERT_TRUE(writer.send(samples::advert("uav1", i)));
  ASSERT_TRUE(reader.wait_for_inbox({50, 0}, kPatience));
  const auto adverts = taken<PlaceAdvert>(reader);
  ASSERT_GE(adverts.size(), 3u);  // a status may have come last
  EXPECT_LE(adverts.size(), 4u);
  EXPECT_EQ(adverts.front().keyframe_id, 50 - adverts.size());
  EXPECT_EQ(adverts.back().keyframe_id, 49u);
  EXPECT_GE(reader.statistics().inbox_dropped, 46u);
}

TEST(PeerLink, TeamsOfOneDomainDoNotHearEachOther) {
  LinkConfig foreign = team_config("uav9");
  foreign.team += "-b";
  PeerLink a(team_config("uav0")), b(team_config("uav1")), stranger(foreign);
  ASSERT_TRUE(a.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(stranger.send(samples::advert("uav9")));
  ASSERT_TRUE(b.send(samples::advert("uav1")));
  ASSERT_TRUE(a.wait_for_inbox({1, 0}, kPatience));
  EXPECT_EQ(taken<PlaceAdvert>(a)[0].sender, "uav1");
  EXPECT_THAT(a.peers(), ElementsAre("uav1"));
}

TEST(PeerLink, ALinkThatIsDestroyedIsMissedAndItsSuccessorIsFound) {
  PeerLink stays(team_config("uav0"));
  // More often than there are ports to look at.
  for (std::uint64_t round = 1; round <= 10; ++round) {
    PeerLink comes_and_goes(team_config("uav1"));
    ASSERT_TRUE(stays.wait_for_peers({"uav1"}, kPatience));
    ASSERT_TRUE(comes_and_goes.wait_for_peers({"uav0"}, kPatience));
    ASSERT_TRUE(stays.send(samples::keyframe("uav0", "uav1")));
    ASSERT_TRUE(comes_and_goes.wait_for_inbox({0, 1}, kPatience));
  }
  EXPECT_EQ(stays.statistics().messages_sent_to.at("uav1"), 10u);
}

LinkConfig config_for_two(const std::string& agent) {
  LinkConfig config = team_config(agent);
  config.max_agents = 2;
  return config;
}

TEST(PeerLink, WhoHasLeftMakesRoomForOthers) {
  PeerLink stays(config_for_two("uav0"));
  for (int i = 1; i <= 10; ++i) {
    const std::string name = "uav" + std::to_string(i);
    PeerLink comes_and_goes(team_config(name));
    ASSERT_TRUE(stays.wait_for_peers({name}, kPatience)) << name;
    ASSERT_TRUE(comes_and_goes.wait_for_peers({"uav0"}, kPatience)) << name;
    ASSERT_TRUE(stays.send(samples::keyframe("uav0", name)));
    ASSERT_TRUE(comes_and_goes.wait_for_inbox({0, 1}, kPatience)) << name;
  }
}

TEST(PeerLink, WhoFindsNoRoomIsCountedAndLinkedOnceThereIsSome) {
  PeerLink stays(config_for_two("uav0"));
  std::optional<PeerLink> first(team_config("uav1"));
  ASSERT_TRUE(stays.wait_for_peers({"uav1"}, kPatience));
  const PeerLink second(team_config("uav2"));
  const auto start = std::chrono::steady_clock::now();
  while (stays.statistics().refused.count(kCrowd) == 0 &&
         std::chrono::steady_clock::now() - start < kPatience)
    std::this_thread::yield();
  EXPECT_EQ(stays.statistics().refused[kCrowd], 1U);
  EXPECT_THAT(stays.peers(), ElementsAre("uav1"));
  first.reset();
  EXPECT_TRUE(stays.wait_for_peers({"uav2"}, kPatience));
  EXPECT_EQ(stays.statistics().refused[kCrowd], 1U);
}

// Answers go to all who are there while one writer after the other is freed.
TEST(PeerLink, WritersAreFreedAmidTheirTraffic) {
  PeerLink stays(config_for_two("uav0"));
  std::atomic<bool> over = false;
  std::thread sender([&] {
    for (int i = 0; !over; ++i)
      stays.send(samples::keyframe("uav0", "uav" + std::to_string(1 + i % 6)));
  });
  for (int i = 1; i <= 6; ++i) {
    const std::string name = "uav" + std::to_string(i);
    PeerLink comes_and_goes(team_config(name));
    EXPECT_TRUE(comes_and_goes.wait_for_inbox({0, 1}, kPatience)) << name;
  }
  over = true;
  sender.join();
}

bool stays_linked(const PeerLink& link, const std::string& peer, std::chrono::milliseconds time) {
  const auto start = std::chrono::steady_clock::now();
  while (std::chrono::steady_clock::now() - start < time) {
    if (link.peers().count(peer) == 0) return false;
    std::this_thread::yield();
  }
  return true;
}

LinkConfig config_with_signs(const std::string& agent, int sign_of_life_ms, int liveliness_ms) {
  LinkConfig config = team_config(agent);
  config.profile.discovery.sign_of_life_ms = sign_of_life_ms;
  config.profile.status.liveliness_ms = liveliness_ms;
  return config;
}

TEST(PeerLink, DronesWithNothingToSayStayLinked) {
  PeerLink a(config_with_signs("uav0", 100, 800)), b(config_with_signs("uav1", 100, 800));
  ASSERT_TRUE(a.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(b.wait_for_peers({"uav0"}, kPatience));
  EXPECT_TRUE(stays_linked(a, "uav1", std::chrono::milliseconds(1200)));
}

// The other one would say nothing for 10 s.
TEST(PeerLink, ASilentPeerIsMadeToAnswer) {
  PeerLink asks(config_with_signs("uav0", 50, 500)),
      silent(config_with_signs("uav1", 10'000, 20'000));
  ASSERT_TRUE(asks.wait_for_peers({"uav1"}, kPatience));
  const std::uint64_t before = asks.statistics().status.sent;
  const auto start = std::chrono::steady_clock::now();
  while (asks.statistics().status.sent < before + 5 &&
         std::chrono::steady_clock::now() - start < kPatience)
    std::this_thread::yield();
  EXPECT_GE(asks.statistics().status.sent, before + 5);
  EXPECT_EQ(asks.peers(), std::set<std::string>{"uav1"});
}

// The next heartbeat of the clock would come after the test.
LinkConfig config_for_questions(const std::string& agent, Reliability reliability) {
  LinkConfig config = team_config(agent);
  config.profile.request.reliability = reliability;
  config.profile.request.piggyback = reliability == Reliability::kReliable;
  config.profile.request.heartbeat_ms = 200'000;
  config.profile.request.lifespan_ms = 0;
  return config;
}

TEST(PeerLink, AQuestionIsAcknowledgedWithoutWaitingForAHeartbeat) {
  PeerLink asks(config_for_questions("uav0", Reliability::kReliable));
  PeerLink hears(config_for_questions("uav1", Reliability::kReliable));
  ASSERT_TRUE(asks.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(asks.send(samples::advert("uav0")));
  EXPECT_TRUE(asks.flush(kPatience));
}

// Without an offer to repair it, a question that had to be acknowledged never would be.
TEST(PeerLink, NobodyAcknowledgesQuestionsThatNeedNoRepair) {
  PeerLink asks(config_for_questions("uav0", Reliability::kBestEffort));
  PeerLink hears(config_for_questions("uav1", Reliability::kBestEffort));
  ASSERT_TRUE(asks.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(asks.send(samples::advert("uav0")));
  EXPECT_TRUE(hears.wait_for_inbox({1, 0}, kPatience));
  EXPECT_TRUE(asks.flush(kPatience));
}

TEST(PeerLink, WhoWantsQuestionsRepairedHearsWhoDoesNotAndTheOtherWayRound) {
  PeerLink repairs(config_for_questions("uav0", Reliability::kReliable));
  PeerLink does_not(config_for_questions("uav1", Reliability::kBestEffort));
  ASSERT_TRUE(repairs.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(does_not.wait_for_peers({"uav0"}, kPatience));
  ASSERT_TRUE(repairs.send(samples::advert("uav0")));
  ASSERT_TRUE(does_not.send(samples::advert("uav1")));
  EXPECT_TRUE(repairs.wait_for_inbox({1, 0}, kPatience));
  EXPECT_TRUE(does_not.wait_for_inbox({1, 0}, kPatience));
}

TEST(PeerLink, TheSettingsTellWhereTheOthersAre) {
  LinkConfig config = team_config("uav0");
  config.initial_peers = {"127.0.0.1", "10.0.0.2", "10.0.0.3", "10.0.0.2"};
  EXPECT_THAT(other_drones(config), IsEmpty()) << "on loopback they share one address";
  config.loopback_only = false;
  EXPECT_THAT(other_drones(config),
              UnorderedElementsAre(inet_addr("10.0.0.2"), inet_addr("10.0.0.3")));
  config.profile.discovery.ports_per_host = 2;
  EXPECT_THAT(other_drones(config), IsEmpty());
}

TEST(PeerLink, APortWhereNoDroneLooksForItIsTold) {
  const LinkConfig config = config_for_two("uav0");
  const int first = 7410 + 250 * config.domain;
  EXPECT_EQ(PeerLink(config).statistics().unseen_port, 0U);
  const TakenPort first_taken(first);
  ASSERT_TRUE(first_taken.taken());
  EXPECT_EQ(PeerLink(config).statistics().unseen_port, 0U) << "two ports are looked at";
  const TakenPort second_taken(first + 2);
  ASSERT_TRUE(second_taken.taken());
  EXPECT_EQ(PeerLink(config).statistics().unseen_port, static_cast<std::uint64_t>(first + 4));
}

// The thread sanitizer sees what this one may not.
TEST(PeerLink, MayBeClosedFromTwoThreadsAtOnce) {
  PeerLink link(team_config("uav0"));
  std::thread other([&] { link.close(); });
  link.close();
  EXPECT_FALSE(link.wait_for_peers(1, kPatience)) << "a wait on a closed link ends at once";
  other.join();
}

TEST(PeerLink, ALockstepLinkSaysEverythingBeforeItGoes) {
  PeerLink reader(lockstep_config("uav0"));
  std::optional<PeerLink> writer(lockstep_config("uav1"));
  ASSERT_TRUE(writer->wait_for_peers({"uav0"}, kPatience));
  for (std::uint64_t i = 0; i < 20; ++i) {
    ASSERT_TRUE(writer->send(samples::advert("uav1", i)));
    ASSERT_TRUE(writer->send(samples::keyframe("uav1", "uav0", 200)));
  }
  writer.reset();
  EXPECT_TRUE(reader.wait_for_inbox({20, 20}, kPatience));
}

FullPeerKeyframe large_message(const std::string& sender, const std::string& receiver) {
  return {samples::keyframe(sender, receiver, 200),
          samples::filter(12, 40)};  // 207 states, 0.35 MB
}

TEST(PeerLink, WholeFiltersReachOneDroneOrAllAndCountOnce) {
  const auto config = [](const std::string& agent) {
    LinkConfig out = lockstep_config(agent);
    out.full_messages = true;
    return out;
  };
  PeerLink a(config("uav0")), b(config("uav1")), c(config("uav2"));
  ASSERT_TRUE(a.wait_for_peers({"uav1", "uav2"}, kPatience));
  const FullPeerKeyframe for_all = large_message("uav0", "");
  constexpr std::uint64_t kCount = 5;
  for (std::uint64_t i = 0; i < kCount; ++i) ASSERT_TRUE(a.send(for_all));
  ASSERT_TRUE(a.send(large_message("uav0", "uav2")));
  EXPECT_FALSE(a.send(samples::keyframe("uav0", "uav1")));  // another sort of message
  ASSERT_TRUE(b.wait_for_inbox({0, kCount}, kPatience));
  ASSERT_TRUE(c.wait_for_inbox({0, kCount + 1}, kPatience));
  const auto got = taken<FullPeerKeyframe>(b);
  ASSERT_EQ(got.size(), kCount);
  EXPECT_EQ(got.back().filter.covariance, for_all.filter.covariance);
  EXPECT_EQ(taken<FullPeerKeyframe>(c).back().keyframe.receiver, "uav2");

  const LinkStatistics sent = a.statistics();
  EXPECT_EQ(sent.message.sent, kCount + 1);
  EXPECT_EQ(sent.message.refused, 1u);
  EXPECT_EQ(sent.messages_sent_to.at("uav1"), kCount);
  EXPECT_EQ(sent.messages_sent_to.at("uav2"), kCount + 1);
  EXPECT_EQ(sent.message.payload_bytes_sent,
            kCount * encode(for_all).size() + encode(large_message("uav0", "uav2")).size());
  EXPECT_GT(sent.wire_bytes_sent, (2 * kCount + 1) * encode(for_all).size());
}

TEST(PeerLink, DronesThatExchangeOtherMessagesAreNotPeers) {
  LinkConfig full = team_config("uav0");
  full.full_messages = true;
  PeerLink a(full), b(team_config("uav1")), c(team_config("uav2"));
  ASSERT_TRUE(b.wait_for_peers({"uav2"}, kPatience));
  EXPECT_THAT(b.peers(), ElementsAre("uav2"));
  EXPECT_THAT(a.peers(), IsEmpty());
}

TEST(PeerLink, DestroyingALinkAmidItsTrafficHarmsNobody) {
  PeerLink reader(team_config("uav0"));
  std::optional<PeerLink> writer(team_config("uav1"));
  ASSERT_TRUE(writer->wait_for_peers({"uav0"}, kPatience));
  for (std::uint64_t i = 0; i < 20; ++i) ASSERT_TRUE(writer->send(samples::advert("uav1", i)));
  writer.reset();
  PeerLink successor(team_config("uav1"));
  EXPECT_TRUE(successor.wait_for_peers({"uav0"}, kPatience));
}

TEST(PeerLink, WithNobodyThereNothingIsLeftToFlush) {
  PeerLink link(lockstep_config("uav0"));
  ASSERT_TRUE(link.send(samples::advert("uav0")));
  EXPECT_TRUE(link.flush(std::chrono::milliseconds(100)));
}

TEST(PeerLink, NamedInterfacesAndHostsWorkWithoutLoopbackOnly) {
  const auto config = [](const std::string& agent) {
    LinkConfig out = team_config(agent);
    out.loopback_only = false;
    out.interfaces = {"127.0.0.1"};
    out.initial_peers = {"127.0.0.1"};
    return out;
  };
  PeerLink a(config("uav0")), b(config("uav1"));
  EXPECT_TRUE(a.wait_for_peers({"uav1"}, kPatience));
  EXPECT_TRUE(b.wait_for_peers({"uav0"}, kPatience));
}

// The longest messages, in both directions at once, by two threads of one link.
TEST(PeerLink, ThreadsMayShareALink) {
  constexpr std::uint64_t kCount = 40;
  PeerLink a(lockstep_config("uav0")), b(lockstep_config("uav1"));
  ASSERT_TRUE(a.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(b.wait_for_peers({"uav0"}, kPatience));
  const auto talk = [](PeerLink& link, const std::string& self, const std::string& peer) {
    std::thread requests([&] {
      for (std::uint64_t i = 0; i < kCount; ++i) link.send(samples::advert(self, i));
    });
    for (std::uint64_t i = 0; i < kCount; ++i) {
      link.send(samples::keyframe(self, peer, 256));
      link.publish(samples::status(self, static_cast<std::uint32_t>(i)));
      link.publish(samples::odometry());
    }
    requests.join();
  };
  std::thread other([&] { talk(b, "uav1", "uav0"); });
  talk(a, "uav0", "uav1");
  other.join();
  EXPECT_TRUE(a.wait_for_inbox({kCount, kCount}, kPatience));
  EXPECT_TRUE(b.wait_for_inbox({kCount, kCount}, kPatience));
  EXPECT_THAT(a.statistics().refused, IsEmpty());
  EXPECT_THAT(a.statistics().rejected, IsEmpty());
}

// Both links read this machine's clock, one of them three seconds too late: what they find is sure
// to half the round trip, whoever had to wait for the processor.
TEST(PeerLink, FindsHowFarThePeersClockIsOff) {
  constexpr TimeNs kAheadNs = 3'000'000'000;
  PeerLink right(team_config("uav0"));
  PeerLink ahead(team_config("uav1"), [] { return wall_clock_ns() + kAheadNs; });
  ASSERT_TRUE(right.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(ahead.wait_for_peers({"uav0"}, kPatience));
  LinkStatistics of_right, of_ahead;
  const auto start = std::chrono::steady_clock::now();
  for (std::uint32_t frames = 0; of_right.clocks.empty() || of_ahead.clocks.empty(); ++frames) {
    ASSERT_LT(std::chrono::steady_clock::now() - start, kPatience);
    ASSERT_TRUE(right.publish(samples::status("uav0", frames)));
    ASSERT_TRUE(ahead.publish(samples::status("uav1", frames)));
    of_right = right.statistics();
    of_ahead = ahead.statistics();
  }
  const ClockOffset of_peer = of_right.clocks.at("uav1"), back = of_ahead.clocks.at("uav0");
  EXPECT_LE(std::abs(of_peer.offset_ns - kAheadNs), of_peer.round_trip_ns / 2 + 1);
  EXPECT_LE(std::abs(back.offset_ns + kAheadNs), back.round_trip_ns / 2 + 1);
}

}  // namespace
}  // namespace covey
