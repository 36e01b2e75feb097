// SPDX-License-Identifier: Apache-2.0
#include "comms/peer_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace covey {
namespace {

using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::IsEmpty;

constexpr std::uint64_t kOwnToken = 99;

PeerId id(std::uint8_t number) {
  PeerId out{};
  out[11] = number;
  return out;
}

testing::Matcher<const HeardPeer&> is(const PeerId& id) {
  return testing::Field(&HeardPeer::token, token(id));
}

void match_all(PeerTable& table, const PeerId& peer) {
  for (std::size_t i = 0; i < kChannels; ++i)
    table.change_matches(peer, static_cast<Channel>(i), +1);
}

TEST(PeerTable, APeerIsLinkedOnceBothSidesHearEachOther) {
  PeerTable table(8);
  table.set_name(id(1), "uav1");
  match_all(table, id(1));
  EXPECT_THAT(table.heard(), ElementsAre(is(id(1))));
  EXPECT_THAT(table.linked(kOwnToken), IsEmpty());
  table.set_hears(id(1), {5, kOwnToken});
  EXPECT_THAT(table.linked(kOwnToken), ElementsAre("uav1"));
}

TEST(PeerTable, WhatIsHeardComesWithTheStampsOfItsNewestStatus) {
  PeerTable table(8);
  match_all(table, id(1));
  EXPECT_EQ(table.heard().front().sent_ns, 0);
  table.set_status_stamps(id(1), 5, 6);
  table.set_status_stamps(id(1), 7, 8);
  EXPECT_EQ(table.heard().front().sent_ns, 7);
  EXPECT_EQ(table.heard().front().received_ns, 8);
  table.remove(id(1));
  match_all(table, id(1));
  EXPECT_EQ(table.heard().front().sent_ns, 0);
}

TEST(PeerTable, EachMissingChannelKeepsAPeerFromBeingLinked) {
  for (std::size_t missing = 0; missing < kChannels; ++missing) {
    PeerTable table(8);
    table.set_name(id(1), "uav1");
    table.set_hears(id(1), {kOwnToken});
    match_all(table, id(1));
    table.change_matches(id(1), static_cast<Channel>(missing), -1);
    EXPECT_THAT(table.linked(kOwnToken), IsEmpty()) << "channel " << missing;
    EXPECT_THAT(table.heard(), IsEmpty()) << "channel " << missing;
  }
}

TEST(PeerTable, ARestartedDroneOfTheSameNameIsAnotherPeer) {
  PeerTable table(8);
  table.set_name(id(1), "uav1");
  table.set_hears(id(1), {kOwnToken});
  match_all(table, id(1));
  table.remove(id(1));
  table.set_name(id(2), "uav1");
  match_all(table, id(2));
  EXPECT_THAT(table.linked(kOwnToken), IsEmpty());
  EXPECT_THAT(table.heard(), ElementsAre(is(id(2))));
}

TEST(PeerTable, ASilentPeerIsAskedThenGoneAndComesBack) {
  PeerTable table(8);
  table.set_name(id(1), "uav1");
  table.set_hears(id(1), {kOwnToken});
  match_all(table, id(1));
  const SilenceLimits limits{milliseconds(100), milliseconds(300)};
  const PeerTable::Time start{};
  const auto check = [&](int ms) {
    const auto silence = table.check_silence(limits, start + milliseconds(ms));
    return std::pair(silence.doubt, silence.gone);
  };
  EXPECT_EQ(check(0), std::pair(false, false)) << "the first look begins the wait";
  EXPECT_EQ(table.next_check(limits, start), start + milliseconds(100));
  EXPECT_FALSE(table.hear({id(1)}, start + milliseconds(50)));
  EXPECT_EQ(check(149), std::pair(false, false));
  EXPECT_EQ(check(150), std::pair(true, false));
  EXPECT_EQ(check(349), std::pair(false, false)) << "asked once";
  EXPECT_EQ(table.next_check(limits, start), start + milliseconds(350));
  EXPECT_THAT(table.linked(kOwnToken), ElementsAre("uav1"));
  EXPECT_EQ(check(350), std::pair(false, true));
  EXPECT_THAT(table.linked(kOwnToken), IsEmpty());
  EXPECT_EQ(check(1000), std::pair(false, false)) << "lost once";
  EXPECT_EQ(table.next_check(limits, start), std::nullopt);
  EXPECT_TRUE(table.hear({id(1)}, start + milliseconds(1001)));
  EXPECT_THAT(table.linked(kOwnToken), ElementsAre("uav1"));
  EXPECT_EQ(check(1101), std::pair(true, false)) << "asked again";
}

TEST(PeerTable, WhoIsNotMatchedIsNotAsked) {
  PeerTable table(8);
  table.set_name(id(1), "uav1");
  const SilenceLimits limits{milliseconds(100), milliseconds(300)};
  const PeerTable::Time start{};
  (void)table.check_silence(limits, start);
  EXPECT_FALSE(table.check_silence(limits, start + milliseconds(200)).doubt);
  EXPECT_EQ(table.next_check(limits, start), start + milliseconds(300));
}

TEST(PeerTable, LosingAMatchAfterTheParticipantEntersNobody) {
  PeerTable table(8);
  table.change_matches(id(1), Channel::kRequestIn, -1);
  EXPECT_FALSE(table.hear({id(1)}, PeerTable::Time()));
  EXPECT_EQ(table.name_of(id(1)), "unknown");
  table.change_matches(id(1), Channel::kRequestIn, +1);
  table.change_matches(id(1), Channel::kRequestIn, -1);
  table.change_matches(id(1), Channel::kRequestIn, -1);
  table.set_name(id(1), "uav1");
  table.set_hears(id(1), {kOwnToken});
  match_all(table, id(1));  // would not suffice if the count had gone below zero
  EXPECT_THAT(table.linked(kOwnToken), ElementsAre("uav1"));
}

TEST(PeerTable, AFloodOfStrangersIsBoundedAndDoesNotPushOutFriends) {
  PeerTable table(4);
  table.set_name(id(1), "uav1");
  match_all(table, id(1));
  for (std::uint8_t stranger = 10; stranger < 200; ++stranger)
    table.set_name(id(stranger), "s" + std::to_string(stranger));
  EXPECT_EQ(table.names().size(), 4u);
  EXPECT_EQ(table.name_of(id(1)), "uav1");
}

TEST(PeerTable, OnlyAMatchedReaderCanBeReached) {
  PeerTable table(8);
  table.set_name(id(1), "uav1");
  EXPECT_FALSE(table.reaches("uav1"));
  table.change_matches(id(1), Channel::kMessageOut, +1);
  EXPECT_TRUE(table.reaches("uav1"));
  EXPECT_FALSE(table.reaches("uav2"));
}

}  // namespace
}  // namespace covey
