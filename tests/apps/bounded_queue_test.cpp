// SPDX-License-Identifier: Apache-2.0
#include "apps/bounded_queue.h"

#include <gtest/gtest.h>

#include <chrono>
#include <memory>
#include <thread>

namespace covey {
namespace {

using std::chrono::seconds;
constexpr seconds kLong{30};  // never waited for when all is well

TEST(BoundedQueue, GivesItemsInTheOrderTheyCame) {
  BoundedQueue<int> queue(3);
  for (const int item : {1, 2, 3}) EXPECT_TRUE(queue.push_drop_oldest(item));
  for (const int item : {1, 2, 3}) EXPECT_EQ(queue.pop_for(kLong), item);
}

TEST(BoundedQueue, DropsTheOldestWhenFullAndCountsIt) {
  BoundedQueue<int> queue(2);
  for (const int item : {1, 2, 3, 4}) EXPECT_TRUE(queue.push_drop_oldest(item));
  EXPECT_EQ(queue.dropped(), 2U);
  EXPECT_EQ(queue.pop_for(kLong), 3);
  EXPECT_EQ(queue.pop_for(kLong), 4);
}

TEST(BoundedQueue, GivesNothingWhenTheTimeIsUp) {
  BoundedQueue<int> queue(1);
  EXPECT_EQ(queue.pop_for(std::chrono::milliseconds(0)), std::nullopt);
  EXPECT_FALSE(queue.finished());
}

TEST(BoundedQueue, GivesWhatItStillHoldsAfterItWasClosed) {
  BoundedQueue<int> queue(2);
  queue.push_drop_oldest(7);
  queue.close();
  EXPECT_FALSE(queue.push_drop_oldest(8));
  EXPECT_FALSE(queue.finished());
  EXPECT_EQ(queue.pop_for(kLong), 7);
  EXPECT_TRUE(queue.finished());
  EXPECT_EQ(queue.dropped(), 0U);
}

TEST(BoundedQueue, ClosingWakesWhoWaits) {
  BoundedQueue<int> empty(1);
  std::thread consumer([&] { EXPECT_EQ(empty.pop_for(kLong), std::nullopt); });
  empty.close();
  consumer.join();
}

TEST(BoundedQueue, WhatArrivesFromAnotherThreadIsInOrderAndTheRestIsCounted) {
  constexpr int kItems = 2000;
  BoundedQueue<std::unique_ptr<int>> queue(3);
  std::thread producer([&] {
    for (int i = 0; i < kItems; ++i) queue.push_drop_oldest(std::make_unique<int>(i));
    queue.close();
  });
  int last = -1, arrived = 0;
  for (; const auto item = queue.pop_for(kLong); ++arrived) {
    EXPECT_LT(last, **item);
    last = **item;
  }
  producer.join();
  EXPECT_EQ(last, kItems - 1);
  EXPECT_EQ(arrived + static_cast<int>(queue.dropped()), kItems);
}

}  // namespace
}  // namespace covey
