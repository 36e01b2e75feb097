// SPDX-License-Identifier: Apache-2.0
#include "comms/outbox.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/comms/samples.h"

namespace covey {
namespace {

using std::chrono::milliseconds;
using testing::ElementsAre;
using testing::Pair;
using testing::UnorderedElementsAre;

constexpr Audience kPeers{2, 0};

Outbox::Time at(int time_ms) { return Outbox::Time(std::chrono::hours(1) + milliseconds(time_ms)); }

// 10 kB/s for the drone, 4 kB/s to one peer.
LoadProfile narrow() {
  LoadProfile out;
  out.drone_bytes_per_s = 10'000;
  out.drone_burst_bytes = 10'000;
  out.link_bytes_per_s = 4'000;
  out.link_burst_bytes = 4'000;
  out.patience_ms = 200;
  return out;
}

LoadProfile with_wide_links() {
  LoadProfile out = narrow();
  out.link_bytes_per_s = 0;
  return out;
}

Outgoing message(const std::string& receiver, std::uint64_t keyframe_id, double worth,
                 std::size_t bytes = 1900) {
  return {Kind::kMessage, {receiver}, keyframe_id, worth, Bytes(bytes)};
}

Outgoing request(std::size_t bytes = 1200) { return {Kind::kRequest, {}, 0, 20, Bytes(bytes)}; }

// What comes out when all that was sent is all that is on the wire.
std::vector<std::uint64_t> sent_keyframes(Outbox& outbox, std::uint64_t& wire_bytes,
                                          Outbox::Time now) {
  std::vector<std::uint64_t> out;
  while (const auto next = outbox.next(wire_bytes, kPeers, now)) {
    wire_bytes += next->bytes.size();
    out.push_back(next->keyframe_id);
  }
  return out;
}

TEST(TokenBucket, ABurstGoesAtOnceAndThenTheRate) {
  TokenBucket bucket(1000, 3000);
  ASSERT_TRUE(bucket.has(3000, at(0)));
  bucket.spend(3000, at(0));
  EXPECT_FALSE(bucket.has(500, at(499)));
  EXPECT_TRUE(bucket.has(500, at(500)));
  EXPECT_FALSE(bucket.has(3000, at(2999)));
  EXPECT_TRUE(bucket.has(3000, at(60'000)));  // no more than the burst has gathered
  bucket.spend(3000, at(60'000));
  EXPECT_FALSE(bucket.has(1, at(60'000)));
}

TEST(TokenBucket, WhatIsLargerThanTheBurstGoesFromAFullBucketAndLeavesADebt) {
  TokenBucket bucket(1000, 1000);
  ASSERT_TRUE(bucket.has(5000, at(0)));
  bucket.spend(5000, at(0));
  EXPECT_FALSE(bucket.has(1, at(4000)));
  EXPECT_TRUE(bucket.has(1, at(4001)));
}

TEST(Outbox, WhatWasFoundGoesBeforeAnAnswerAndHoldsNoLandmarks) {
  Outbox outbox(narrow());
  std::uint64_t wire_bytes = 0;
  const Bytes found = encode(samples::found());
  outbox.offer(message("uav1", 5, worth(samples::keyframe("uav1", "uav0", 95)), 2700), at(0));
  outbox.offer({Kind::kMessage, {"uav1"}, 0, worth(samples::found()), found}, at(0));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(0)), ElementsAre(0, 5));
}

TEST(Outbox, WhatDdsSendsByItselfIsOwedForOneBurstAtMost) {
  Outbox outbox(narrow());
  std::uint64_t wire_bytes = 200'000;  // drones finding each other
  EXPECT_FALSE(outbox.next(wire_bytes, kPeers, at(0)));
  outbox.offer(request(), at(1100));
  EXPECT_FALSE(outbox.next(wire_bytes, kPeers, at(1100))) << "what was sent is still paid for";
  EXPECT_TRUE(outbox.next(wire_bytes, kPeers, at(1290)));
}

Outgoing odometry(std::size_t bytes = 300) { return {Kind::kOdometry, {}, 0, 1, Bytes(bytes)}; }

// When the first question goes, from a second after 100 kB of discovery on.
int first_question_ms(Outbox& outbox, std::uint64_t wire_bytes, int now_ms) {
  (void)outbox.next(wire_bytes + 100'000, kPeers, at(now_ms));
  outbox.offer(request(), at(now_ms));
  int waited_ms = 0;
  while (!outbox.next(wire_bytes + 100'000, kPeers, at(now_ms + waited_ms))) waited_ms += 10;
  return waited_ms;
}

LoadProfile patient() {
  LoadProfile out = with_wide_links();
  out.patience_ms = 60'000;
  return out;
}

TEST(Outbox, OdometryThatNobodyListensToOwesNothing) {
  Outbox silent(patient()), tells(patient());
  std::uint64_t wire_bytes = 0;
  for (int time_ms = 0; time_ms < 60'000; time_ms += 50) {
    tells.offer(odometry(), at(time_ms));
    EXPECT_TRUE(tells.next(wire_bytes, kPeers, at(time_ms)));
  }
  EXPECT_EQ(first_question_ms(tells, wire_bytes, 60'000),
            first_question_ms(silent, wire_bytes, 60'000));
}

TEST(Outbox, OdometryIsPaidForByListenersNotByPeers) {
  Outbox outbox(narrow());
  outbox.offer(odometry(900), at(0));
  EXPECT_TRUE(outbox.next(8'500, {30, 1}, at(0)));  // 1.5 kB left
  outbox.offer(odometry(900), at(0));
  EXPECT_FALSE(outbox.next(8'500, {30, 2}, at(0)));
}

TEST(Outbox, WhatWasLetGoToSomebodyWhoHasGoneIsSoonForgotten) {
  Outbox silent(patient()), answers(patient());
  answers.offer(message("uav1", 1, 40, 60'000), at(0));
  EXPECT_TRUE(answers.next(0, kPeers, at(0)));
  EXPECT_EQ(first_question_ms(answers, 0, 1100), first_question_ms(silent, 0, 1100));
}

TEST(Outbox, WhatTheDroneLetsGoIsOwedInFull) {
  Outbox outbox(with_wide_links());
  outbox.offer(message("uav1", 1, 40, 60'000), at(0));
  ASSERT_TRUE(outbox.next(0, kPeers, at(0)));
  EXPECT_FALSE(outbox.next(60'000, kPeers, at(0)));
  outbox.offer(request(), at(5200));
  EXPECT_FALSE(outbox.next(60'000, kPeers, at(5250)));
  EXPECT_TRUE(outbox.next(60'000, kPeers, at(5270)));
}

TEST(Outbox, WithoutLimitsEverythingGoesAtOnce) {
  LoadProfile load;
  load.drone_bytes_per_s = load.link_bytes_per_s = 0;
  Outbox outbox(load);
  EXPECT_TRUE(outbox.unlimited());
  for (std::uint64_t i = 0; i < 20; ++i) outbox.offer(message("uav1", i, 40), at(0));
  std::uint64_t wire_bytes = 0;
  EXPECT_EQ(sent_keyframes(outbox, wire_bytes, at(0)).size(), 20u);
}

TEST(Outbox, TheBestConditionedGoesFirstWhenTheRadioIsFull) {
  Outbox outbox(with_wide_links());
  std::uint64_t wire_bytes = 10'000;  // discovery and repair have taken the burst
  EXPECT_FALSE(outbox.next(wire_bytes, kPeers, at(0)));
  outbox.offer(message("uav1", 1, 10), at(0));
  outbox.offer(message("uav1", 2, 40), at(0));
  outbox.offer(message("uav2", 3, 20), at(0));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(100)), ElementsAre());
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(200)), ElementsAre(2));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(201)), ElementsAre());
  EXPECT_TRUE(outbox.empty());
  EXPECT_THAT(outbox.dropped(), ElementsAre(Pair("message found no room in time", 2)));
}

TEST(Outbox, OfTwoThatAreWorthTheSameTheNewerGoesFirst) {
  Outbox outbox(with_wide_links());
  std::uint64_t wire_bytes = 10'000;
  EXPECT_FALSE(outbox.next(wire_bytes, kPeers, at(0)));
  outbox.offer(message("uav1", 1, 40), at(10));
  outbox.offer(message("uav1", 2, 40), at(60));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(205)), ElementsAre(2));
}

TEST(Outbox, WhatThePeerHoldsAlreadyComesAfterWhatIsNewToIt) {
  Outbox outbox(with_wide_links());
  std::uint64_t wire_bytes = 0;
  outbox.offer(message("uav1", 1, 40), at(0));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(0)), ElementsAre(1));
  wire_bytes += 8100;
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(0)), ElementsAre());
  outbox.offer(message("uav1", 1, 40), at(1));
  outbox.offer(message("uav1", 2, 20), at(1));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(201)), ElementsAre(2));
  // To another peer it is new.
  outbox.offer(message("uav2", 1, 40), at(202));
  outbox.offer(message("uav2", 3, 20), at(202));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(401)), ElementsAre(1));
}

TEST(Outbox, SmallAndUsefulComesBeforeLargeAndUseful) {
  Outbox outbox(with_wide_links());
  std::uint64_t wire_bytes = 10'000;
  EXPECT_FALSE(outbox.next(wire_bytes, kPeers, at(0)));
  outbox.offer(message("uav1", 1, 40, 9000), at(0));
  outbox.offer(message("uav1", 2, 30, 1000), at(0));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(150)), ElementsAre(2));
}

TEST(Outbox, OneFullLinkDoesNotStarveTheOthers) {
  Outbox outbox(narrow());
  std::uint64_t wire_bytes = 0;
  for (std::uint64_t i = 0; i < 4; ++i) outbox.offer(message("uav1", i, 90), at(0));
  outbox.offer(message("uav2", 9, 10), at(0));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(0)), UnorderedElementsAre(2, 3, 9));
}

// Of two messages to it, one with a keyframe that it was sent before: which one goes first?
std::uint64_t first_sent_to(const std::string& peer, Outbox& outbox, Outbox::Time now) {
  outbox.offer(message(peer, 1, 40), now);
  outbox.offer(message(peer, 2, 20), now);
  std::uint64_t wire_bytes = 0;
  return sent_keyframes(outbox, wire_bytes, now).at(0);
}

TEST(Outbox, OfThousandsOfNamesOnlyThoseLatelySentToAreRemembered) {
  LoadProfile load;
  load.drone_bytes_per_s = load.link_bytes_per_s = 0;
  Outbox outbox(load);
  std::uint64_t wire_bytes = 0;
  outbox.offer(message("stays away", 1, 40), at(0));
  for (int i = 0; i < 3000; ++i) {
    outbox.offer(message("uav" + std::to_string(i), 9, 40), at(i));
    if (i % 50 == 0) outbox.offer(message("comes back", 1, 40), at(i));
    sent_keyframes(outbox, wire_bytes, at(i));
  }
  EXPECT_EQ(first_sent_to("comes back", outbox, at(3000)), 2u);
  EXPECT_EQ(first_sent_to("stays away", outbox, at(3000)), 1u);
}

TEST(Outbox, WithoutPatienceGoesWhatFindsRoomAtOnce) {
  LoadProfile load = with_wide_links();
  load.patience_ms = 0;
  Outbox outbox(load);
  std::uint64_t wire_bytes = 0;
  outbox.offer(message("uav1", 1, 40), at(0));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(1)), ElementsAre(1));
  wire_bytes += 10'000;  // discovery and repair
  outbox.offer(message("uav1", 2, 40), at(2));
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(3)), ElementsAre());
  EXPECT_THAT(sent_keyframes(outbox, wire_bytes, at(60'000)), ElementsAre());
  EXPECT_TRUE(outbox.empty());
  EXPECT_THAT(outbox.dropped(), ElementsAre(Pair("message found no room in time", 1)));
}

TEST(Outbox, AMessageForAllGoesToThoseWhoseLinksHaveRoom) {
  Outbox outbox(narrow());
  std::uint64_t wire_bytes = 0;
  outbox.offer(message("uav1", 1, 40, 3900), at(0));
  ASSERT_THAT(sent_keyframes(outbox, wire_bytes, at(0)), ElementsAre(1));
  Outgoing both = message("uav1", 2, 40);
  both.receivers.insert("uav2");
  outbox.offer(both, at(1));
  const auto out = outbox.next(wire_bytes, kPeers, at(1));
  ASSERT_TRUE(out);
  EXPECT_THAT(out->receivers, ElementsAre("uav2"));
  EXPECT_THAT(outbox.dropped(), ElementsAre(Pair("message found no room in time", 1)));
}

TEST(Outbox, AQuestionNeedsRoomForEveryPeerThatHearsIt) {
  Outbox outbox(narrow());
  outbox.offer(request(), at(0));
  EXPECT_FALSE(outbox.next(8'000, kPeers, at(0)));  // 2 kB left
  EXPECT_TRUE(outbox.next(8'000, {1, 0}, at(0)));
}

std::vector<int> sent_marks(Outbox& outbox, std::uint64_t& wire_bytes, Outbox::Time now) {
  std::vector<int> out;
  while (const auto next = outbox.next(wire_bytes, kPeers, now)) {
    wire_bytes += next->bytes.size() * kPeers.peers;
    out.push_back(next->bytes[0]);
  }
  return out;
}

Outgoing question(std::uint8_t mark, std::size_t bytes) {
  return {Kind::kRequest, {}, 0, 20, Bytes(bytes, mark)};
}

TEST(Outbox, AQuestionNeverLeavesAfterANewerOne) {
  LoadProfile load = with_wide_links();
  load.patience_ms = 500;
  Outbox outbox(load);
  std::uint64_t wire_bytes = 12'000;  // 2 kB are owed
  EXPECT_FALSE(outbox.next(wire_bytes, kPeers, at(0)));
  outbox.offer(question(1, 1200), at(0));
  EXPECT_THAT(sent_marks(outbox, wire_bytes, at(340)), ElementsAre());
  outbox.offer(question(2, 100), at(350));
  std::vector<int> marks;
  for (int time_ms = 350; time_ms < 1000; time_ms += 10) {
    const std::vector<int> sent = sent_marks(outbox, wire_bytes, at(time_ms));
    marks.insert(marks.end(), sent.begin(), sent.end());
  }
  EXPECT_THAT(marks, ElementsAre(2));
  EXPECT_THAT(outbox.dropped(), ElementsAre(Pair("request overtaken by a newer one", 1)));
}

TEST(Outbox, QuestionsThatAllFindRoomAllLeaveInTheOrderOfOffering) {
  Outbox outbox(with_wide_links());
  std::uint64_t wire_bytes = 0;
  std::vector<int> marks;
  for (const auto& [mark, bytes] : {std::pair(1, 1200), std::pair(2, 100), std::pair(3, 600)}) {
    outbox.offer(question(static_cast<std::uint8_t>(mark), bytes), at(mark));
    const std::vector<int> sent = sent_marks(outbox, wire_bytes, at(mark));
    marks.insert(marks.end(), sent.begin(), sent.end());
  }
  EXPECT_THAT(marks, ElementsAre(1, 2, 3));
  EXPECT_THAT(outbox.dropped(), ElementsAre());
}

TEST(Outbox, OnlyTheNewestOdometryWaits) {
  Outbox outbox(narrow());
  EXPECT_FALSE(outbox.next(10'000, kPeers, at(0)));
  outbox.offer({Kind::kOdometry, {}, 0, 1, Bytes(300, 1)}, at(0));
  outbox.offer({Kind::kOdometry, {}, 0, 1, Bytes(300, 2)}, at(33));
  const auto out = outbox.next(10'000, kPeers, at(100));
  ASSERT_TRUE(out);
  EXPECT_EQ(out->bytes[0], 2);
  EXPECT_THAT(outbox.dropped(), ElementsAre(Pair("odometry replaced by a newer one", 1)));
}

TEST(Outbox, OfTooManyTheLeastUsefulIsDropped) {
  Outbox outbox(with_wide_links());
  EXPECT_FALSE(outbox.next(10'000, kPeers, at(0)));
  for (std::uint64_t i = 0; i < 65; ++i) outbox.offer(message("uav1", i, i == 7 ? 1 : 40), at(0));
  EXPECT_THAT(outbox.dropped(), ElementsAre(Pair("message less useful than others", 1)));
}

// A minute of ten times too much: what goes out keeps to the rate, and nothing is ever late.
TEST(Outbox, SaturatedItKeepsToItsRateAndQueuesNothing) {
  Outbox outbox(with_wide_links());
  std::uint64_t wire_bytes = 0, offered = 0, sent = 0;
  for (int time_ms = 0; time_ms < 60'000; time_ms += 20) {
    outbox.offer(message("uav1", offered++, 40), at(time_ms));
    const auto out = sent_keyframes(outbox, wire_bytes, at(time_ms));
    sent += out.size();
    for (const std::uint64_t id : out) EXPECT_LE((offered - 1 - id) * 20, 200u);
  }
  EXPECT_NEAR(static_cast<double>(wire_bytes), 60 * 10'000, 20'000);
  EXPECT_GE(offered - sent, outbox.dropped().at("message found no room in time"));
  EXPECT_LE(offered - sent, outbox.dropped().at("message found no room in time") + 10);
}

TEST(Worth, LandmarksCountByHowWellTheirDepthIsKnown) {
  PeerKeyframe keyframe = samples::keyframe("uav1", "uav0", 10);
  const double well_known = worth(keyframe);
  for (PeerLandmark& landmark : keyframe.landmarks)
    landmark.inverse_depth_sigma = landmark.inverse_depth;
  EXPECT_GT(well_known, 5);
  EXPECT_LT(worth(keyframe), 0.2);
}

}  // namespace
}  // namespace covey
