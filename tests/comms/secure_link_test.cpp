// SPDX-License-Identifier: Apache-2.0
//
// Who is in the team, and who is not, over DDS Security. That somebody hears nothing shows only
// when there was time to hear: a drone that belongs to the team starts after the intruder, and is
// found before anything is judged.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <variant>

#include "comms/convert.h"
#include "tests/comms/forged_packet.h"
#include "tests/comms/samples.h"
#include "tests/comms/secure_team.h"

namespace covey {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

std::vector<std::uint64_t> keyframes_asked_for(PeerLink& link) {
  std::vector<std::uint64_t> out;
  for (const Inbound& inbound : link.take())
    if (const auto* advert = std::get_if<PlaceAdvert>(&inbound)) out.push_back(advert->keyframe_id);
  return out;
}

void expect_kept_out(const SecureTeam& team, const LinkConfig& intruder_config) {
  PeerLink drone(team.config("uav0"));
  PeerLink intruder(intruder_config);
  PeerLink late(team.config("uav2"));
  ASSERT_TRUE(drone.wait_for_peers({"uav2"}, kPatience));
  ASSERT_TRUE(late.wait_for_peers({"uav0"}, kPatience));
  intruder.send(samples::advert("uav1", 666));
  ASSERT_TRUE(drone.send(samples::advert("uav0", 5)));
  ASSERT_TRUE(late.send(samples::advert("uav2", 7)));
  ASSERT_TRUE(late.wait_for_inbox({1, 0}, kPatience));
  ASSERT_TRUE(drone.wait_for_inbox({1, 0}, kPatience));
  EXPECT_THAT(keyframes_asked_for(drone), ElementsAre(7));
  EXPECT_THAT(keyframes_asked_for(late), ElementsAre(5));
  EXPECT_THAT(drone.peers(), ElementsAre("uav2"));
  EXPECT_THAT(intruder.peers(), IsEmpty());
  EXPECT_THAT(intruder.take(), IsEmpty());
}

TEST(SecureLink, DronesOfOneTeamTalk) {
  const SecureTeam team({"uav0", "uav1"});
  PeerLink asker(team.config("uav0")), other(team.config("uav1"));
  ASSERT_TRUE(asker.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(other.wait_for_peers({"uav0"}, kPatience));
  ASSERT_TRUE(asker.send(samples::advert("uav0", 5)));
  ASSERT_TRUE(other.wait_for_inbox({1, 0}, kPatience));
  const PeerKeyframe answer = samples::keyframe("uav1", "uav0", 250);  // several datagrams
  ASSERT_TRUE(other.send(answer));
  ASSERT_TRUE(asker.wait_for_inbox({0, 1}, kPatience));
  const auto received = asker.take();
  const auto* keyframe = std::get_if<PeerKeyframe>(&received.back());
  ASSERT_NE(keyframe, nullptr);
  EXPECT_EQ(keyframe->landmarks.size(), answer.landmarks.size());
}

TEST(SecureLink, AnOutsiderWithoutKeysIsKeptOut) {
  const SecureTeam team({"uav0", "uav2"});
  LinkConfig outsider = team_config("uav1");
  expect_kept_out(team, outsider);
}

TEST(SecureLink, AnotherTeamOfTheSameNameIsKeptOut) {
  const SecureTeam team({"uav0", "uav2"}), other({"uav1"});
  expect_kept_out(team, other.config("uav1"));
}

TEST(SecureLink, ARevokedDroneIsKeptOut) {
  SecureTeam team({"uav0", "uav1", "uav2"});
  const std::string revoked = team.revoke("uav1");
  for (const char* drone : {"uav0", "uav2"}) team.write(drone, kRevokedFile, revoked);
  expect_kept_out(team, team.config("uav1"));
}

// Fast DDS takes submessages that nobody has protected: only protected samples keep them out. The
// open team shows that the forgery is a good one.
TEST(SecureLink, AForgedPacketInTheNameOfADroneIsNotBelieved) {
  const SecureTeam team({"uav0", "uav1"});
  for (const bool secured : {false, true}) {
    const LinkConfig victim_config = secured ? team.config("uav0") : team_config("uav0");
    const LinkConfig speaker_config = secured ? team.config("uav1") : team_config("uav1");
    EavesdroppingForger forger(victim_config);
    PeerLink victim(victim_config);
    forger.hear_prefix();  // the victim's own
    PeerLink speaker(speaker_config);
    ASSERT_TRUE(victim.wait_for_peers({"uav1"}, kPatience));
    ASSERT_TRUE(speaker.wait_for_peers({"uav0"}, kPatience));
    PlaceAdvert forged = samples::advert("uav1", 666);
    forged.descriptor.resize(512);  // one datagram
    forger.send_as_every_other(encode(forged));
    if (!secured) {
      ASSERT_TRUE(victim.wait_for_inbox({1, 0}, kPatience));
    }
    // Of the same number, which the victim takes once.
    ASSERT_TRUE(speaker.send(samples::advert("uav1", 7)));
    ASSERT_TRUE(victim.wait_for_inbox({1, 0}, kPatience));
    EXPECT_THAT(keyframes_asked_for(victim), ElementsAre(secured ? 7 : 666));
  }
}

}  // namespace
}  // namespace covey
