// SPDX-License-Identifier: Apache-2.0
#include "comms/link_state.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/comms/samples.h"

namespace covey {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

PeerId uav1_id() {
  PeerId out{};
  out[0] = 1;
  return out;
}

TEST(LinkState, TheInboxKeepsTheOrderOfArrivalAcrossKinds) {
  LinkState state("uav0", 8);
  state.receive(Kind::kRequest, encode(samples::advert("uav1", 1)), uav1_id());
  state.receive(Kind::kMessage, encode(samples::keyframe("uav1", "uav0")), uav1_id());
  state.receive(Kind::kStatus, encode(StatusSample{samples::status("uav1"), {}}), uav1_id());
  state.receive(Kind::kRequest, encode(samples::advert("uav1", 2)), uav1_id());
  const std::vector<Inbound> inbox = state.take();
  ASSERT_EQ(inbox.size(), 4u);
  EXPECT_EQ(std::get<PlaceAdvert>(inbox[0]).keyframe_id, 1u);
  EXPECT_EQ(std::get<PeerKeyframe>(inbox[1]).sender, "uav1");
  EXPECT_EQ(std::get<AgentStatus>(inbox[2]).agent, "uav1");
  EXPECT_EQ(std::get<PlaceAdvert>(inbox[3]).keyframe_id, 2u);
  EXPECT_TRUE(state.take().empty());
}

TEST(LinkState, AFullInboxDropsItsOldestAndCounts) {
  LinkState state("uav0", 3);
  for (std::uint64_t i = 1; i <= 5; ++i)
    state.receive(Kind::kRequest, encode(samples::advert("uav1", i)), uav1_id());
  const std::vector<Inbound> inbox = state.take();
  ASSERT_EQ(inbox.size(), 3u);
  EXPECT_EQ(std::get<PlaceAdvert>(inbox[0]).keyframe_id, 3u);
  EXPECT_EQ(std::get<PlaceAdvert>(inbox[2]).keyframe_id, 5u);
  EXPECT_EQ(state.statistics().inbox_dropped, 2u);
  EXPECT_EQ(state.arrived().requests, 5u);
}

TEST(LinkState, RejectionsAreCountedByPeerAndReason) {
  LinkState state("uav0", 8);
  state.receive(Kind::kRequest, Bytes{0, 1, 0, 0}, uav1_id());
  state.name_peer(uav1_id(), "uav1");
  Bytes other_version = encode(samples::advert("uav1"));
  other_version[4] = 1;
  state.receive(Kind::kRequest, other_version, uav1_id());
  state.receive(Kind::kRequest, other_version, uav1_id());
  state.receive(Kind::kMessage, encode(samples::keyframe("uav1", "uav2")), uav1_id());
  state.receive(Kind::kMessage, encode(samples::keyframe("uav0", "uav0")), uav1_id());
  auto rejected = state.statistics().rejected;
  EXPECT_EQ(rejected["unknown"]["sample too short"], 1u);
  EXPECT_EQ(rejected["uav1"]["another version of the messages"], 2u);
  EXPECT_EQ(rejected["uav1"]["meant for another drone"], 1u);
  EXPECT_EQ(rejected["uav1"]["another drone bears this drone's name"], 1u);
  EXPECT_TRUE(state.take().empty());
  EXPECT_EQ(state.statistics().request.received, 0u);
  // They have arrived all the same: a lockstep run does not wait for them for ever.
  EXPECT_EQ(state.arrived().requests, 3u);
  EXPECT_EQ(state.arrived().messages, 2u);
}

TEST(LinkState, MessagesToThousandsOfNamesAreCountedUnderAFewHundred) {
  LinkState state("uav0", 8);
  for (int i = 0; i < 3000; ++i) state.count_message_to("uav" + std::to_string(i));
  state.count_message_to("uav7");
  const auto sent_to = state.statistics().messages_sent_to;
  ASSERT_EQ(sent_to.size(), 301u);
  EXPECT_EQ(sent_to.at("uav7"), 2u);
  EXPECT_EQ(sent_to.at("others"), 2700u);
}

TEST(LinkState, AWholeFilterIsForThisDroneOrForAll) {
  LinkState state("uav0", 8);
  state.receive(Kind::kFullMessage, encode(samples::full_keyframe("uav1", "uav0")), uav1_id());
  state.receive(Kind::kFullMessage, encode(samples::full_keyframe("uav1", "")), uav1_id());
  state.receive(Kind::kFullMessage, encode(samples::full_keyframe("uav1", "uav2")), uav1_id());
  const std::vector<Inbound> inbox = state.take();
  ASSERT_EQ(inbox.size(), 2u);
  EXPECT_EQ(std::get<FullPeerKeyframe>(inbox[0]).keyframe.receiver, "uav0");
  EXPECT_EQ(std::get<FullPeerKeyframe>(inbox[1]).keyframe.receiver, "");
  EXPECT_EQ(state.arrived().messages, 3u);
  EXPECT_EQ(state.statistics().message.received, 2u);
}

TEST(LinkState, AStatusThatOnlyRepeatsItselfIsDeliveredOnce) {
  LinkState state("uav0", 8);
  state.receive(Kind::kStatus, encode(StatusSample{samples::status("uav1", 1), {}}), uav1_id());
  state.receive(Kind::kStatus, encode(StatusSample{samples::status("uav1", 1), {{7}}}), uav1_id());
  state.receive(Kind::kStatus, encode(StatusSample{samples::status("uav1", 2), {{7}}}), uav1_id());
  EXPECT_EQ(state.take().size(), 2u);
  EXPECT_EQ(state.statistics().status.received, 2u);
}

// A status goes there in 40 ms, waits for 460 ms, and the peer's comes back in 40 ms.
TEST(LinkState, TheClockOfAPeerIsKnownOnceStatusesWentBothWays) {
  TimeNs now_ns = 1'000'000'000'000;
  LinkState state("uav0", 8, {}, [&] { return now_ns; });
  PeerId own_id{};
  own_id[0] = 99;
  state.set_own_id(own_id);
  constexpr TimeNs kAheadNs = 3'000'000'000;

  const TimeNs sent_ns = state.to_be_said(samples::status("uav0")).sent_ns;
  EXPECT_EQ(sent_ns, now_ns);
  StatusSample peers{samples::status("uav1"), {{7, 1, 2}, {token(own_id)}}, 0};
  const auto receive = [&] { state.receive(Kind::kStatus, encode(peers), uav1_id()); };
  peers.sent_ns = now_ns + kAheadNs;
  receive();  // it has heard of no status yet
  EXPECT_TRUE(state.statistics().clocks.empty());

  peers.hears[1] = {token(own_id), sent_ns, sent_ns + 40'000'000 + kAheadNs};
  peers.sent_ns = sent_ns + 500'000'000 + kAheadNs;
  now_ns = sent_ns + 540'000'000;
  receive();
  const ClockOffset clock = state.statistics().clocks.at("uav1");
  EXPECT_EQ(clock.offset_ns, kAheadNs);
  EXPECT_EQ(clock.round_trip_ns, 80'000'000);

  // What it says next cannot be.
  peers.hears[1].received_ns = peers.sent_ns + 1;
  receive();
  EXPECT_EQ(state.statistics().clocks.at("uav1").offset_ns, kAheadNs);
}

TEST(LinkState, TheOwnStatusSaysWhenThoseOfItsPeersCame) {
  TimeNs now_ns = 1'000'000'000'000;
  LinkState state("uav0", 8, {}, [&] { return now_ns; });
  for (std::size_t i = 0; i < kChannels; ++i)
    state.change_matches(uav1_id(), static_cast<Channel>(i), +1, {});
  state.receive(Kind::kStatus, encode(StatusSample{samples::status("uav1"), {}, 77}), uav1_id());
  now_ns += 5;
  const StatusSample own = state.to_be_said(samples::status("uav0"));
  ASSERT_EQ(own.hears.size(), 1U);
  EXPECT_EQ(own.hears[0].token, token(uav1_id()));
  EXPECT_EQ(own.hears[0].sent_ns, 77);
  EXPECT_EQ(own.hears[0].received_ns, now_ns - 5);
  EXPECT_EQ(own.sent_ns, now_ns);
}

TEST(LinkState, PayloadBytesAreThoseOfTheSamples) {
  LinkState state("uav0", 8);
  const Bytes sample = encode(samples::keyframe("uav1", "uav0"));
  state.receive(Kind::kMessage, sample, uav1_id());
  EXPECT_EQ(state.statistics().message.payload_bytes_received, sample.size());
}

TEST(LinkState, AWaitForTheInboxEndsWhenEnoughHasArrived) {
  LinkState state("uav0", 8);
  bool arrived = false;
  std::thread waiter([&] { arrived = state.wait_for_inbox({2, 1}, seconds(30)); });
  state.receive(Kind::kRequest, encode(samples::advert("uav1", 1)), uav1_id());
  state.receive(Kind::kMessage, encode(samples::keyframe("uav1", "uav0")), uav1_id());
  state.receive(Kind::kRequest, encode(samples::advert("uav1", 2)), uav1_id());
  waiter.join();
  EXPECT_TRUE(arrived);
  EXPECT_FALSE(state.wait_for_inbox({3, 1}, milliseconds(1)));
  EXPECT_FALSE(state.wait_for_inbox({2, 2}, milliseconds(1)));
}

constexpr in_addr_t kPlaceOf1 = 1, kPlaceOf2 = 2, kElsewhere = 3;

void link(LinkState& state, const PeerId& own, const PeerId& peer,
          const std::string& name = "uav1") {
  state.set_own_id(own);
  state.enter_participant(peer, {});
  state.name_peer(peer, name);
  for (std::size_t i = 0; i < kChannels; ++i)
    state.change_matches(peer, static_cast<Channel>(i), +1, {});
  state.receive(Kind::kStatus, encode(StatusSample{samples::status(name), {{token(own)}}, 0}),
                peer);
}

TEST(LinkState, ASilentPeerIsDoubtedThenGoneUntilItIsHeard) {
  LinkState state("uav0", 8, {{milliseconds(20), milliseconds(40)}, {}});
  link(state, PeerId{}, uav1_id());
  const auto later = [] { return std::chrono::steady_clock::now() + seconds(60); };
  bool doubted = false;
  while (!state.peers().empty()) doubted |= state.wait_for_housekeeping(later())->doubt;
  EXPECT_TRUE(doubted);
  state.hear({uav1_id()}, std::chrono::steady_clock::now());
  EXPECT_EQ(state.peers(), std::set<std::string>{"uav1"});
}

// It forgot this drone when it heard nothing for its lease. What it said before is not what it
// hears now, and would keep this drone from calling it.
TEST(LinkState, WhoOnlyAnnouncesItselfHasLostThisDroneAndIsCalled) {
  const auto now = std::chrono::steady_clock::now();
  LinkState state("uav0", 8, {{milliseconds(20), milliseconds(40)}, {kPlaceOf1}});
  PeerId own{};
  own[0] = 7;
  link(state, own, uav1_id());
  state.hear({uav1_id(), kPlaceOf1}, now);
  ASSERT_TRUE(state.complete(now));
  const auto announce = [&] {
    state.hear({uav1_id(), kPlaceOf1, true}, std::chrono::steady_clock::now());
  };
  while (!state.peers().empty()) {
    announce();
    (void)state.wait_for_housekeeping(std::chrono::steady_clock::now() + milliseconds(5));
  }
  announce();
  EXPECT_FALSE(state.complete(now));
  state.hear({uav1_id(), kPlaceOf1}, std::chrono::steady_clock::now());
  EXPECT_TRUE(state.complete(now));
}

TEST(LinkState, ATeamIsCompleteOnceAllAreLinkedAndNobodyIsNew) {
  const auto now = std::chrono::steady_clock::now();
  LinkState unknown("uav0", 8), larger("uav0", 8, {{}, {kPlaceOf1, kPlaceOf2}}),
      state("uav0", 8, {{}, {kPlaceOf1}});
  PeerId own{}, newcomer{};
  own[0] = 7;
  newcomer[0] = 9;
  EXPECT_FALSE(state.complete(now));
  for (LinkState* each : {&unknown, &larger, &state}) {
    link(*each, own, uav1_id());
    each->hear({uav1_id(), kPlaceOf1}, now - seconds(9));
  }
  EXPECT_FALSE(unknown.complete(now));
  EXPECT_FALSE(larger.complete(now));
  EXPECT_TRUE(state.complete(now));
  state.hear({uav1_id(), kPlaceOf1}, now);
  state.hear({own, kElsewhere}, now);
  EXPECT_TRUE(state.complete(now));
  state.hear({newcomer, kElsewhere}, now);
  EXPECT_FALSE(state.complete(now + seconds(4)));
  state.enter_participant(newcomer, now);
  state.hear({newcomer, kElsewhere}, now + seconds(4));
  EXPECT_TRUE(state.complete(now + seconds(6)));
  state.remove_participant(uav1_id());
  EXPECT_FALSE(state.complete(now + seconds(6)));
}

// Whoever has come first, and whoever is lost later.
TEST(LinkState, WhoIsNotOfTheTeamTakesNobodysPlaceInIt) {
  const auto now = std::chrono::steady_clock::now();
  LinkState state("uav0", 8, {{}, {kPlaceOf1, kPlaceOf2}});
  PeerId own{}, ground{}, uav2{};
  own[0] = 7;
  ground[0] = 8;
  uav2[0] = 9;
  link(state, own, uav1_id());
  link(state, own, ground, "ground");
  state.hear({uav1_id(), kPlaceOf1}, now);
  state.hear({ground, kElsewhere}, now);
  EXPECT_FALSE(state.complete(now + seconds(60))) << "uav2 is still called";
  link(state, own, uav2, "uav2");
  state.hear({uav2, kPlaceOf2}, now);
  EXPECT_TRUE(state.complete(now + seconds(60)));
  state.remove_participant(uav2);
  EXPECT_FALSE(state.complete(now + seconds(60)));
}

TEST(LinkState, ATeamOfKnownSizeIsCompleteWhereverItsDronesAre) {
  const auto now = std::chrono::steady_clock::now();
  LinkState state("uav0", 8, {{}, {}, 3}), placed("uav0", 8, {{}, {kPlaceOf1, kPlaceOf2}, 2});
  PeerId own{}, uav2{};
  own[0] = 7;
  uav2[0] = 9;
  for (LinkState* each : {&state, &placed}) {
    link(*each, own, uav1_id());
    each->hear({uav1_id(), kPlaceOf1}, now);
  }
  EXPECT_FALSE(placed.complete(now + seconds(60))) << "places say more than a number";
  EXPECT_FALSE(state.complete(now + seconds(60)));
  link(state, own, uav2, "uav2");
  state.hear({uav2, kPlaceOf1}, now);
  EXPECT_TRUE(state.complete(now + seconds(60)));
  state.remove_participant(uav1_id());
  EXPECT_FALSE(state.complete(now + seconds(60)));
}

TEST(LinkState, ANewcomerIsWaitedForUntilItIsLinkedOrDoesNotGetOn) {
  const auto now = std::chrono::steady_clock::now();
  LinkState state("uav0", 8);
  PeerId own{}, stranger{};
  own[0] = 7;
  stranger[0] = 9;
  EXPECT_EQ(state.waiting(now).since, LinkState::Time::max());
  link(state, own, uav1_id());
  EXPECT_EQ(state.waiting(now).since, LinkState::Time::max());
  state.enter_participant(stranger, now);
  EXPECT_EQ(state.waiting(now).participants, 2);
  EXPECT_EQ(state.waiting(now + seconds(1)).since, now);
  EXPECT_EQ(state.waiting(now + seconds(3)).since, LinkState::Time::max());
  state.change_matches(stranger, Channel::kStatusIn, +1, now + seconds(6));
  EXPECT_EQ(state.waiting(now + seconds(7)).since, now + seconds(6));
  state.change_matches(stranger, Channel::kStatusIn, -1, now + seconds(7));
  EXPECT_EQ(state.waiting(now + seconds(8)).since, now + seconds(6));
  state.remove_participant(stranger);
  EXPECT_EQ(state.waiting(now + seconds(8)).since, LinkState::Time::max());
}

TEST(LinkState, ClosingEndsEveryWait) {
  LinkState state("uav0", 8);
  bool inbox = true, peers = true, housekeeping = true;
  std::thread a([&] { inbox = state.wait_for_inbox({1, 0}, seconds(60)); });
  std::thread b([&] {
    peers = state.wait_for_peers([](const auto& linked) { return !linked.empty(); }, seconds(60));
  });
  std::thread c([&] {
    housekeeping =
        state.wait_for_housekeeping(std::chrono::steady_clock::now() + seconds(60)).has_value();
  });
  state.close();
  a.join();
  b.join();
  c.join();
  EXPECT_FALSE(inbox);
  EXPECT_FALSE(peers);
  EXPECT_FALSE(housekeeping);
}

}  // namespace
}  // namespace covey
