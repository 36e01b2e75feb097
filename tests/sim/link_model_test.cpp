// SPDX-License-Identifier: Apache-2.0
#include "sim/link_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace covey {
namespace {

constexpr std::size_t kFrame = 1000;  // bytes

NetworkModel network_of(const LinkQuality& quality, std::size_t drones = 2) {
  NetworkModel network;
  network.drones = drones;
  network.quality = quality;
  return network;
}

LinkQuality lossy(double loss, double mean_burst = 1) {
  LinkQuality quality;
  quality.loss = loss;
  quality.mean_burst = mean_burst;
  return quality;
}

// One frame each millisecond over the link from 0 to 1.
std::vector<FrameVerdict> send(LinkModel& model, int frames, double from_s = 0) {
  std::vector<FrameVerdict> verdicts;
  for (int i = 0; i < frames; ++i) {
    verdicts.push_back(model.offer(from_s + 1e-3 * i, 0, 1, kFrame));
  }
  return verdicts;
}

struct Losses {
  double share = 0;
  double mean_burst = 0;  // frames
};

Losses losses_of(const std::vector<FrameVerdict>& verdicts) {
  int lost = 0, bursts = 0;
  bool before = false;
  for (const FrameVerdict& verdict : verdicts) {
    const bool now = verdict.fate == FrameFate::kLost;
    lost += now ? 1 : 0;
    bursts += now && !before ? 1 : 0;
    before = now;
  }
  return {static_cast<double>(lost) / static_cast<double>(verdicts.size()),
          bursts == 0 ? 0.0 : static_cast<double>(lost) / bursts};
}

TEST(LinkModel, LosesTheShareItIsToldInBurstsOfTheLengthItIsTold) {
  for (const double loss : {0.0, 0.05, 0.3, 0.4}) {
    for (const double burst : {1.0, 4.0, 20.0}) {
      SCOPED_TRACE(testing::Message() << loss << " in bursts of " << burst);
      LinkModel model(network_of(lossy(loss, burst)), 7);
      const int frames = 60'000;
      const Losses losses = losses_of(send(model, frames));
      const double expected_burst = std::max(burst, 1 / (1 - loss));
      // The share of a two-state chain has about (2 burst - 1) times the variance of a coin's.
      const double sigma = std::sqrt(loss * (1 - loss) * 2 * expected_burst / frames);
      EXPECT_NEAR(losses.share, loss, 4 * sigma);
      if (loss > 0) {
        EXPECT_NEAR(losses.mean_burst, expected_burst, 0.15 * expected_burst);
      }
    }
  }
}

TEST(LinkModel, TheSameSeedGivesTheSameFateAndAnotherOneAnotherFate) {
  LinkQuality quality = lossy(0.3, 3);
  quality.jitter_s = 0.01;
  const auto arrivals = [&](std::uint64_t seed) {
    LinkModel model(network_of(quality), seed);
    std::vector<double> times;
    for (const FrameVerdict& verdict : send(model, 500)) times.push_back(verdict.arrives_s);
    return times;
  };
  EXPECT_EQ(arrivals(1), arrivals(1));
  EXPECT_NE(arrivals(1), arrivals(2));
}

TEST(LinkModel, WhatHappensOnOtherLinksChangesNothing) {
  LinkModel quiet(network_of(lossy(0.3), 3), 5), busy(network_of(lossy(0.3), 3), 5);
  for (int i = 0; i < 500; ++i) {
    const double now_s = 1e-3 * i;
    (void)busy.offer(now_s, 1, 0, kFrame);
    (void)busy.offer(now_s, 0, 2, kFrame);
    EXPECT_EQ(quiet.offer(now_s, 0, 1, kFrame).fate, busy.offer(now_s, 0, 1, kFrame).fate);
  }
}

TEST(LinkModel, DelaysByDelayAndAtMostJitterAndKeepsTheOrder) {
  LinkQuality quality;
  quality.delay_s = 0.02;
  quality.jitter_s = 0.05;
  LinkModel model(network_of(quality), 3);
  double last_s = 0, longest_s = 0;
  const std::vector<FrameVerdict> verdicts = send(model, 1000);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const double took_s = verdicts[i].arrives_s - 1e-3 * static_cast<double>(i);
    EXPECT_GE(verdicts[i].arrives_s, last_s);
    EXPECT_GE(took_s, 0.02);
    EXPECT_LE(took_s, 0.02 + 0.05 + 1e-9);
    last_s = verdicts[i].arrives_s;
    longest_s = std::max(longest_s, took_s);
  }
  EXPECT_GT(longest_s, 0.06);
}

TEST(LinkModel, ARateSpacesFramesOutAndAFullQueueDropsTheRest) {
  LinkQuality quality;
  quality.rate_bit_per_s = 1e6;  // 8 ms for each frame
  quality.queue_s = 0.1;
  LinkModel model(network_of(quality), 1);
  int delivered = 0, dropped = 0;
  for (int i = 0; i < 100; ++i) {  // all at once
    const FrameVerdict verdict = model.offer(5.0, 0, 1, kFrame);
    if (verdict.fate == FrameFate::kQueueFull) {
      ++dropped;
      continue;
    }
    ++delivered;
    EXPECT_NEAR(verdict.arrives_s, 5.0 + 0.008 * delivered, 1e-9);
  }
  EXPECT_EQ(delivered, 13);  // the last one waits 96 ms
  EXPECT_EQ(delivered + dropped, 100);
  // Once it has drained, a frame takes its own 8 ms again.
  EXPECT_NEAR(model.offer(6.0, 0, 1, kFrame).arrives_s, 6.008, 1e-9);
}

TEST(LinkModel, ALostFrameHasTakenItsTimeOnTheAir) {
  LinkQuality quality = lossy(0.5);
  quality.rate_bit_per_s = 1e6;
  quality.queue_s = 1e3;
  LinkModel model(network_of(quality), 1);
  FrameVerdict last;
  for (int i = 0; i < 100; ++i) {
    const FrameVerdict verdict = model.offer(0, 0, 1, kFrame);
    if (verdict.fate == FrameFate::kDelivered) last = {verdict.fate, verdict.arrives_s / (i + 1)};
  }
  EXPECT_NEAR(last.arrives_s, 0.008, 1e-9);
}

TEST(LinkModel, APartitionCutsBothWaysForItsTimeOfTheFlight) {
  NetworkModel network = network_of({}, 4);
  network.partitions = {{2, 5, {0, 3}}};
  LinkModel model(network, 1);
  const auto cut = [&](double now_s, std::size_t from, std::size_t to) {
    return model.offer(now_s, from, to, kFrame).fate == FrameFate::kCut;
  };
  EXPECT_FALSE(cut(3, 0, 1)) << "the flight has not begun";
  model.begin_flight(10, 0.5);  // 2 s of the flight are over at 14, 5 s at 20
  EXPECT_FALSE(cut(13.9, 0, 1));
  EXPECT_TRUE(cut(14.1, 0, 1));
  EXPECT_TRUE(cut(14.1, 1, 0));
  EXPECT_TRUE(cut(14.1, 2, 3));
  EXPECT_FALSE(cut(14.1, 0, 3)) << "both on one side";
  EXPECT_FALSE(cut(14.1, 1, 2));
  EXPECT_TRUE(cut(19.9, 0, 1));
  EXPECT_FALSE(cut(20.1, 0, 1));
}

TEST(LinkModel, QualityFollowsTheDistanceAsTheDronesFly) {
  NetworkModel network = network_of({});
  network.range.half_range_m = 30;
  network.distance_m = [](std::size_t, std::size_t, double flown_s) { return flown_s; };  // 1 m/s
  const auto loss_at = [&](double distance_m) {
    LinkModel model(network, 11);
    model.begin_flight(-distance_m, 1);
    int lost = 0;
    for (int i = 0; i < 20'000; ++i) {
      lost += model.offer(0, 0, 1, kFrame).fate == FrameFate::kLost ? 1 : 0;
    }
    return lost / 20'000.0;
  };
  EXPECT_LT(loss_at(10), 0.01);
  EXPECT_NEAR(loss_at(30), 0.5, 0.02);
  EXPECT_NEAR(loss_at(60), 64.0 / 65, 0.01);
}

TEST(LinkModel, ASpecialLinkIsWorseInOneDirectionOnly) {
  NetworkModel network = network_of({});
  network.special[{0, 1}] = lossy(0.9);
  LinkModel model(network, 2);
  int there = 0, back = 0;
  for (int i = 0; i < 1000; ++i) {
    there += model.offer(i, 0, 1, kFrame).fate == FrameFate::kLost ? 1 : 0;
    back += model.offer(i, 1, 0, kFrame).fate == FrameFate::kLost ? 1 : 0;
  }
  EXPECT_NEAR(there, 900, 50);
  EXPECT_EQ(back, 0);
}

}  // namespace
}  // namespace covey
