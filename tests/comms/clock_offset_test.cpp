// SPDX-License-Identifier: Apache-2.0
#include "comms/clock_offset.h"

#include <gtest/gtest.h>

#include <limits>
#include <random>

#include "comms/checks.h"

namespace covey {
namespace {

constexpr TimeNs kMs = 1'000'000, kSecond = 1000 * kMs;
constexpr TimeNs kStart = 1'700'000'000'000 * kMs;  // own clock

// Two clocks and the way between them.
struct Way {
  TimeNs ahead_ns = 0;  // the peer's clock
  TimeNs there_ns = 0, back_ns = 0;
  TimeNs wait_ns = 700 * kMs;  // until the peer's next status
};

RoundTrip trip(TimeNs sent_ns, const Way& way) {
  RoundTrip out;
  out.sent_ns = sent_ns;
  out.heard_ns = sent_ns + way.there_ns + way.ahead_ns;
  out.answered_ns = out.heard_ns + way.wait_ns;
  out.received_ns = out.answered_ns - way.ahead_ns + way.back_ns;
  return out;
}

// One round trip each second.
void add(ClockFilter& filter, int count, const Way& way, TimeNs from_ns = kStart) {
  for (int i = 0; i < count; ++i) EXPECT_TRUE(filter.add(trip(from_ns + i * kSecond, way)));
}

TEST(ClockOffset, IsExactWhereBothWaysTakeEquallyLong) {
  for (const TimeNs ahead_ns : {TimeNs{0}, 3000 * kMs, -3000 * kMs, 7 * kMs, -kStart / 2}) {
    const auto offset = clock_offset(trip(kStart, {ahead_ns, 20 * kMs, 20 * kMs}));
    ASSERT_TRUE(offset.has_value());
    EXPECT_EQ(offset->offset_ns, ahead_ns);
    EXPECT_EQ(offset->round_trip_ns, 40 * kMs);
  }
}

TEST(ClockOffset, ErrsByHalfTheDifferenceOfTheWaysAndIsSureToHalfTheirSum) {
  const auto offset = clock_offset(trip(kStart, {100 * kMs, 50 * kMs, 10 * kMs}));
  ASSERT_TRUE(offset.has_value());
  EXPECT_EQ(offset->offset_ns, 120 * kMs);
  EXPECT_LE(offset->offset_ns - 100 * kMs, offset->round_trip_ns / 2);
}

TEST(ClockFilter, JitterIsFilteredAndLossesDoNotMatter) {
  std::mt19937 random(3);
  std::exponential_distribution<double> waiting(1.0 / 60e6);  // ns
  ClockFilter filter;
  for (int second = 0; second < 200; ++second) {
    Way way{-250 * kMs, 5 * kMs, 5 * kMs};
    way.there_ns += static_cast<TimeNs>(waiting(random));
    way.back_ns += static_cast<TimeNs>(waiting(random));
    const bool lost = random() % 3 == 0;
    if (lost) continue;
    EXPECT_TRUE(filter.add(trip(kStart + second * kSecond, way)));
    if (second < 20) continue;
    const ClockOffset best = filter.best().value();
    EXPECT_LE(std::abs(best.offset_ns + 250 * kMs), best.round_trip_ns / 2);
    EXPECT_LT(best.round_trip_ns, 130 * kMs);  // one waits for 120 ms on average
  }
}

TEST(ClockFilter, TheFastestOfTheNewestEightIsTaken) {
  ClockFilter filter;
  EXPECT_FALSE(filter.best().has_value());
  add(filter, 1, {kMs, 2 * kMs, 2 * kMs});
  add(filter, 7, {kMs, 80 * kMs, 10 * kMs}, kStart + kSecond);
  EXPECT_EQ(filter.best()->round_trip_ns, 4 * kMs);
  EXPECT_EQ(filter.best()->offset_ns, kMs);
  add(filter, 1, {kMs, 80 * kMs, 10 * kMs}, kStart + 8 * kSecond);
  EXPECT_EQ(filter.best()->round_trip_ns, 90 * kMs);
}

TEST(ClockFilter, AClockThatIsSetIsBelievedAtOnce) {
  for (const TimeNs step_ns : {2000 * kMs, -2000 * kMs, 30 * kMs}) {
    ClockFilter filter;
    add(filter, 8, {100 * kMs, kMs, kMs});
    add(filter, 1, {100 * kMs + step_ns, 20 * kMs, 5 * kMs}, kStart + 8 * kSecond);
    EXPECT_NEAR(static_cast<double>(filter.best()->offset_ns - step_ns), 1e8, 8e6);
  }
}

TEST(ClockFilter, AnOwnClockThatIsSetBackIsBelievedAtOnce) {
  ClockFilter filter;
  add(filter, 8, {0, kMs, kMs});
  add(filter, 1, {3600 * kSecond, kMs, kMs}, kStart - 3600 * kSecond);
  EXPECT_EQ(filter.best()->offset_ns, 3600 * kSecond);
}

TEST(ClockFilter, ClocksThatDriftApartAreFollowedAndNotTakenForSet) {
  ClockFilter filter;
  for (int second = 0; second < 100; ++second) {
    const TimeNs drifted_ns = second * kMs / 20;  // 50 parts per million
    add(filter, 1, {drifted_ns, kMs, kMs + (second % 4) * kMs}, kStart + second * kSecond);
    EXPECT_LE(filter.best()->round_trip_ns, second < 4 ? 5 * kMs : 2 * kMs);
    EXPECT_NEAR(static_cast<double>(filter.best()->offset_ns - drifted_ns), 0, 2e6);
  }
}

// A microsecond on the way is less than what two clocks drift apart while the peer waits.
TEST(ClockOffset, AWayThatDriftMakesShorterThanNothingIsNothing) {
  RoundTrip fast = trip(kStart, {0, 0, 0});
  fast.answered_ns += 10'000;
  EXPECT_EQ(clock_offset(fast).value().round_trip_ns, 0);
  fast.answered_ns += kMs;
  EXPECT_FALSE(clock_offset(fast).has_value());
}

TEST(ClockFilter, StampsThatNoTwoClocksCanHaveReadAreRefused) {
  ClockFilter filter;
  add(filter, 1, {kMs, kMs, kMs});
  constexpr TimeNs kLeast = std::numeric_limits<TimeNs>::min();
  constexpr TimeNs kMost = std::numeric_limits<TimeNs>::max();
  const RoundTrip good = trip(kStart + kSecond, {kMs, kMs, kMs});
  for (TimeNs RoundTrip::*stamp : {&RoundTrip::sent_ns, &RoundTrip::heard_ns,
                                   &RoundTrip::answered_ns, &RoundTrip::received_ns})
    for (const TimeNs bad : {kLeast, TimeNs{-1}, TimeNs{0}, kMaxStampNs + 1, kMost}) {
      RoundTrip damaged = good;
      damaged.*stamp = bad;
      EXPECT_FALSE(filter.add(damaged)) << bad;
    }
  RoundTrip back_before_sent = good;
  back_before_sent.received_ns = good.sent_ns - 1;
  EXPECT_FALSE(filter.add(back_before_sent));
  RoundTrip answered_before_heard = good;
  answered_before_heard.answered_ns = good.heard_ns - 1;
  EXPECT_FALSE(filter.add(answered_before_heard));
  EXPECT_FALSE(filter.add(trip(kStart, {0, 6000 * kMs, 6000 * kMs})));
  EXPECT_EQ(filter.best()->offset_ns, kMs);
}

// The largest differences that stamps can have: the sanitizers see to the rest.
TEST(ClockFilter, TheEndsOfTimeDoNotOverflow) {
  ClockFilter filter;
  EXPECT_TRUE(filter.add({1, kMaxStampNs, kMaxStampNs, 1}));
  EXPECT_EQ(filter.best()->offset_ns, kMaxStampNs - 1);
  EXPECT_TRUE(filter.add({kMaxStampNs, 1, 1, kMaxStampNs}));
  EXPECT_EQ(filter.best()->offset_ns, 1 - kMaxStampNs);
}

}  // namespace
}  // namespace covey
