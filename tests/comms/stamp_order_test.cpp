// SPDX-License-Identifier: Apache-2.0
#include "comms/stamp_order.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <vector>

namespace covey {
namespace {

using testing::ElementsAre;
using testing::IsEmpty;

struct Stamped {
  TimeNs stamp_ns = 0;
};

// Its stamps are in milliseconds.
class Sensor {
 public:
  std::vector<TimeNs> says(const std::vector<TimeNs>& stamps) {
    constexpr TimeNs kMillisecond_ns = 1'000'000;
    std::vector<TimeNs> believed;
    for (const TimeNs stamp : stamps)
      for (const Stamped& sample : order_.add({stamp * kMillisecond_ns}))
        believed.push_back(sample.stamp_ns / kMillisecond_ns);
    return believed;
  }
  std::size_t finish() { return order_.finish().size(); }
  [[nodiscard]] const StampCounts& counts() const { return order_.counts(); }

 private:
  StampOrder<Stamped> order_;
};

TEST(StampOrder, WhatComesInOrderIsBelievedFromTheFirstOn) {
  Sensor sensor;
  EXPECT_THAT(sensor.says({100'000, 100'100}), IsEmpty()) << "two may be chance";
  EXPECT_THAT(sensor.says({100'200}), ElementsAre(100'000, 100'100, 100'200));
  EXPECT_THAT(sensor.says({100'300}), ElementsAre(100'300));
  EXPECT_THAT(sensor.says({101'300}), ElementsAre(101'300)) << "a second later";
  EXPECT_EQ(sensor.counts().left_out(), 0U);
}

TEST(StampOrder, AWrongStampCostsItsOwnSampleAlone) {
  for (const TimeNs wrong : {TimeNs{5'000}, TimeNs{102'000}, TimeNs{2'000'000'000'000}}) {
    Sensor sensor;
    EXPECT_THAT(sensor.says({100'000, 100'100, 100'200, wrong, 100'300, 100'400}),
                ElementsAre(100'000, 100'100, 100'200, 100'300, 100'400))
        << wrong;
    EXPECT_EQ(sensor.counts().wrong, 1U) << wrong;
    EXPECT_EQ(sensor.counts().left_out(), 1U) << wrong;
  }
}

TEST(StampOrder, TheFirstStampMayBeTheWrongOne) {
  Sensor sensor;
  EXPECT_THAT(sensor.says({2'000'000'000'000, 100'000, 100'100, 100'200}),
              ElementsAre(100'000, 100'100, 100'200));
  EXPECT_EQ(sensor.counts().wrong, 1U);
}

TEST(StampOrder, WrongStampsThatDoNotAgreeAreNeverBelieved) {
  Sensor sensor;
  EXPECT_THAT(sensor.says({100'000, 100'100, 100'200, 500'000, 900'000, 7'000, 700'000, 701'500,
                           703'000, 100'300}),
              ElementsAre(100'000, 100'100, 100'200, 100'300));
  EXPECT_EQ(sensor.counts().wrong, 6U);
}

TEST(StampOrder, AfterARealGapNothingIsLost) {
  Sensor sensor;
  sensor.says({100'000, 100'100, 100'200});
  EXPECT_THAT(sensor.says({160'000, 160'100}), IsEmpty());
  EXPECT_THAT(sensor.says({160'200, 160'300}), ElementsAre(160'000, 160'100, 160'200, 160'300));
  EXPECT_EQ(sensor.counts().left_out(), 0U);
}

TEST(StampOrder, WhatIsLateOrRepeatedIsLeftOut) {
  Sensor sensor;
  EXPECT_THAT(sensor.says({100'000, 100'000, 100'100, 100'100, 100'200, 100'200}),
              ElementsAre(100'000, 100'100, 100'200));
  EXPECT_THAT(sensor.says({100'050, 100'100, 100'150, 99'500, 100'300}), ElementsAre(100'300));
  EXPECT_EQ(sensor.counts().late, 7U);
  EXPECT_EQ(sensor.counts().set_back, 0U);
}

TEST(StampOrder, AClockThatIsSetBackIsTold) {
  Sensor sensor;
  sensor.says({100'000, 100'100, 100'200});
  EXPECT_THAT(sensor.says({70'000, 70'100}), IsEmpty());
  EXPECT_EQ(sensor.counts().set_back, 0U) << "two may be chance";
  EXPECT_THAT(sensor.says({70'200, 70'300}), IsEmpty());
  EXPECT_EQ(sensor.counts().set_back, 2U);
  EXPECT_NEAR(sensor.counts().set_back_s, 29.9, 1e-6);
  EXPECT_THAT(sensor.says({100'300}), ElementsAre(100'300)) << "set right again";
  EXPECT_EQ(sensor.counts().left_out(), 4U);
}

TEST(StampOrder, AClockThatIsSetBackIsBelievedOnceItHasCaughtUp) {
  Sensor sensor;
  sensor.says({100'000, 100'100, 100'200});
  std::vector<TimeNs> stamps;
  for (TimeNs stamp = 70'000; stamp <= 100'300; stamp += 100) stamps.push_back(stamp);
  EXPECT_THAT(sensor.says(stamps), ElementsAre(100'300));
}

TEST(StampOrder, TooFewToTellAreBelievedInTheEnd) {
  Sensor sensor;
  sensor.says({100'000, 100'100});
  EXPECT_EQ(sensor.finish(), 2U);
  EXPECT_EQ(sensor.counts().left_out(), 0U);
}

TEST(StampOrder, WhatIsFarFromAllBeforeAndIsHeldInTheEndIsWrong) {
  Sensor sensor;
  sensor.says({100'000, 100'100, 100'200, 160'000, 160'100});
  EXPECT_EQ(sensor.finish(), 0U);
  EXPECT_EQ(sensor.counts().wrong, 2U);
}

}  // namespace
}  // namespace covey
