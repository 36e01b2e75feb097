// SPDX-License-Identifier: Apache-2.0
#include "apps/sensor_clocks.h"

#include <gtest/gtest.h>

namespace covey {
namespace {

const TimeNs kStart_ns = nanoseconds(1000);

TEST(SensorClocks, OfOneClockAreNeverComplainedAbout) {
  SensorClocks clocks;
  for (int i = 0; i < 200; ++i) {
    const double now_ms = 10.0 * i;
    const TimeNs now_ns = kStart_ns + i * nanoseconds(0.01);
    if (i % 5 == 0) {
      EXPECT_FALSE(clocks.see_image(now_ns, now_ms));
    }
    EXPECT_FALSE(clocks.see_imu(now_ns, now_ms));
    EXPECT_FALSE(clocks.waits_in_vain(now_ms));
  }
}

TEST(SensorClocks, AreComparedInBothDirections) {
  SensorClocks ahead;
  EXPECT_FALSE(ahead.see_image(kStart_ns + nanoseconds(1000), 0)) << "no IMU has spoken";
  EXPECT_NEAR(ahead.see_imu(kStart_ns, 5).value_or(0), 1000, 1e-6);
  SensorClocks behind;
  EXPECT_FALSE(behind.see_imu(kStart_ns, 0)) << "no image has come";
  EXPECT_NEAR(behind.see_image(kStart_ns - nanoseconds(900), 5).value_or(0), -900, 1e-6);
}

TEST(SensorClocks, ASilentSensorIsNoOtherClock) {
  SensorClocks clocks;
  (void)clocks.see_image(kStart_ns, 0);
  (void)clocks.see_imu(kStart_ns, 0);
  EXPECT_FALSE(clocks.see_imu(kStart_ns + nanoseconds(10), 1e4)) << "the camera is silent";
  EXPECT_FALSE(clocks.see_image(kStart_ns + nanoseconds(20), 2e4)) << "the IMU is silent";
  EXPECT_FALSE(clocks.waits_in_vain(2.2e4)) << "the image waits for an IMU that may come back";
}

TEST(SensorClocks, AnImageFarAheadWaitsInVainAfterASecond) {
  SensorClocks clocks;
  (void)clocks.see_image(kStart_ns + nanoseconds(1000), 0);
  (void)clocks.see_imu(kStart_ns, 900);
  EXPECT_FALSE(clocks.waits_in_vain(900));
  (void)clocks.see_imu(kStart_ns + nanoseconds(0.2), 1100);
  EXPECT_TRUE(clocks.waits_in_vain(1100));
  (void)clocks.see_image(kStart_ns + nanoseconds(1001), 1105);
  EXPECT_FALSE(clocks.waits_in_vain(1110)) << "another one";
  (void)clocks.see_imu(kStart_ns + nanoseconds(1000.5), 2200);
  EXPECT_FALSE(clocks.waits_in_vain(2200)) << "the IMU's clock has come near";
}

}  // namespace
}  // namespace covey
