// SPDX-License-Identifier: Apache-2.0
#include "frontend/answer_limiter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

namespace covey {
namespace {

constexpr TimeNs kStep_ns = 50'000'000;

TimeNs at(double seconds) { return static_cast<TimeNs>(seconds * 1e9); }

struct Sent {
  double landmarks_per_s = 0;                // to all peers together
  int fewest_answers = 0, most_answers = 0;  // of the peers
};

// Peers that ask all the time, in turns; counted once the first ten seconds are over.
Sent answer_all(const AnswerLimiter::Config& config, int peers) {
  constexpr int kSteps = 1200, kSettled = 200;
  AnswerLimiter limiter(config);
  std::vector<int> answers(static_cast<std::size_t>(peers));
  double landmarks = 0;
  for (int step = 0; step < kSteps; ++step) {
    const TimeNs now_ns = step * kStep_ns;
    for (int peer = 0; peer < peers; ++peer) {
      const std::string name = "uav" + std::to_string(peer);
      if (!limiter.allows(name, now_ns)) continue;
      if (step >= kSettled) {
        landmarks += limiter.max_landmarks(name, now_ns);
        ++answers[static_cast<std::size_t>(peer)];
      }
      limiter.sent(name, 1, now_ns);
    }
  }
  const auto [fewest, most] = std::minmax_element(answers.begin(), answers.end());
  return {landmarks / (1e-9 * kStep_ns * (kSteps - kSettled)), *fewest, *most};
}

TEST(AnswerLimiter, FewPeersGetTheLargestAnswersAtTheFullRate) {
  const AnswerLimiter::Config config;
  for (const int peers : {1, 2}) {
    const Sent sent = answer_all(config, peers);
    EXPECT_NEAR(sent.landmarks_per_s, peers * config.max_landmarks / config.answer_interval_s, 4);
  }
}

TEST(AnswerLimiter, ManyPeersShareWhatIsSentAndNoneIsLeftOut) {
  const AnswerLimiter::Config config;
  for (const int peers : {3, 5, 8, 31, 64}) {
    const Sent sent = answer_all(config, peers);
    EXPECT_LE(sent.landmarks_per_s, 1.05 * config.landmarks_per_s) << peers;
    EXPECT_GE(sent.landmarks_per_s, 0.9 * config.landmarks_per_s) << peers;
    EXPECT_LE(sent.most_answers - sent.fewest_answers, 1) << peers;
  }
}

TEST(AnswerLimiter, ManyPeersKeepWithinASmallBudgetToo) {
  AnswerLimiter::Config config;
  config.max_peers = 200;
  config.landmarks_per_s = 300;
  EXPECT_LE(answer_all(config, 200).landmarks_per_s, 1.1 * config.landmarks_per_s);
}

TEST(AnswerLimiter, WhoAsksNoMoreHasNoShare) {
  AnswerLimiter limiter({});
  for (const char* peer : {"uav1", "uav2", "uav3"}) limiter.sent(peer, 1, at(10));
  EXPECT_LT(limiter.max_landmarks("uav1", at(11)), AnswerLimiter::Config{}.max_landmarks);
  EXPECT_EQ(limiter.max_landmarks("uav1", at(20)), AnswerLimiter::Config{}.max_landmarks);
}

TEST(AnswerLimiter, WithoutABoundEverybodyGetsTheLargestAnswers) {
  AnswerLimiter::Config config;
  config.landmarks_per_s = 0;
  EXPECT_NEAR(answer_all(config, 10).landmarks_per_s,
              10 * config.max_landmarks / config.answer_interval_s, 40);
}

TEST(AnswerLimiter, WhatWasSentMayGoAgainAfterAWhile) {
  AnswerLimiter limiter({});
  limiter.sent("uav1", 7, at(10));
  EXPECT_TRUE(limiter.has_just_sent("uav1", 7, at(11.9)));
  EXPECT_FALSE(limiter.has_just_sent("uav1", 7, at(12.1)));
  EXPECT_FALSE(limiter.has_just_sent("uav1", 8, at(11)));
  EXPECT_FALSE(limiter.has_just_sent("uav2", 7, at(11)));
}

TEST(AnswerLimiter, WhoFindsNothingIsAnsweredMoreRarelyUntilItDoes) {
  AnswerLimiter limiter({});
  limiter.sent("uav1", 1, at(10), true);
  EXPECT_FALSE(limiter.allows("uav1", at(10.9)));
  EXPECT_TRUE(limiter.allows("uav1", at(11)));
  limiter.sent("uav1", 2, at(11), true);
  EXPECT_FALSE(limiter.allows("uav1", at(12.9)));
  for (int i = 0; i < 20; ++i) {  // but never more rarely than a keyframe may be repeated
    limiter.sent("uav1", 3, at(13 + 2 * i), true);
    EXPECT_TRUE(limiter.allows("uav1", at(15 + 2 * i)));
  }
  limiter.found("uav1");
  EXPECT_TRUE(limiter.allows("uav1", at(51.5)));
  EXPECT_FALSE(limiter.allows("uav1", at(51.4)));
}

TEST(AnswerLimiter, WhoInventsMoreNamesGetsNoAnswerUntilOthersHaveLeft) {
  AnswerLimiter::Config config;
  config.max_peers = 2;
  AnswerLimiter limiter(config);
  limiter.sent("uav1", 1, at(10));
  limiter.sent("uav2", 1, at(10));
  EXPECT_FALSE(limiter.allows("uav3", at(11)));
  EXPECT_FALSE(limiter.allows("uav3", at(15)));
  EXPECT_TRUE(limiter.allows("uav1", at(15)));
  EXPECT_TRUE(limiter.allows("uav3", at(30)));
}

}  // namespace
}  // namespace covey
