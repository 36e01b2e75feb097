// SPDX-License-Identifier: Apache-2.0
#include "apps/flight_time.h"

#include <gtest/gtest.h>

namespace covey {
namespace {

const TimeNs kFirst_ns = nanoseconds(1000);

// Images each 50 ms, for so long; stamps are so far ahead of what they would be.
void fly(FlightTime& time, double from_s, double to_s, double set_forward_s = 0) {
  for (double at_s = from_s; at_s < to_s; at_s += 0.05)
    time.see_image(kFirst_ns + nanoseconds(at_s + set_forward_s), 1e3 * at_s);
}

TEST(FlightTime, IsThatOfTheStampsHoweverFastImagesCome) {
  FlightTime time(10, kFirst_ns, 0);
  for (int i = 1; i <= 200; ++i) {
    time.see_image(kFirst_ns + i * nanoseconds(0.05), i);
    EXPECT_FALSE(time.is_over(i)) << i;
  }
  EXPECT_EQ(time.flown_s(), 10);
  time.see_image(kFirst_ns + 201 * nanoseconds(0.05), 201);
  EXPECT_TRUE(time.is_over(201));
}

TEST(FlightTime, AClockThatIsSetForwardDoesNotEndTheFlight) {
  FlightTime time(600, kFirst_ns, 0);
  fly(time, 0, 3);
  fly(time, 3, 590, 3600);
  EXPECT_NEAR(time.flown_s(), 590, 1.1);
  EXPECT_FALSE(time.is_over(590e3));
  fly(time, 590, 602, 3600);
  EXPECT_TRUE(time.is_over(602e3));
}

TEST(FlightTime, AGapOfTheCameraCounts) {
  FlightTime time(600, kFirst_ns, 0);
  fly(time, 0, 3);
  fly(time, 300, 303);
  EXPECT_NEAR(time.flown_s(), 303, 0.2);
}

TEST(FlightTime, IsOverByThisComputersClockOnceNoMoreImagesCome) {
  FlightTime time(10, kFirst_ns, 0);
  fly(time, 0, 9.9);
  EXPECT_FALSE(time.is_over(10.5e3)) << "the next one may come";
  EXPECT_TRUE(time.is_over(11e3));
}

TEST(FlightTime, WithoutADurationIsNeverOver) {
  FlightTime time(0, kFirst_ns, 0);
  fly(time, 0, 100);
  EXPECT_FALSE(time.is_over(1e9));
}

}  // namespace
}  // namespace covey
