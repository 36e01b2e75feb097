// SPDX-License-Identifier: Apache-2.0
#include "frontend/temporal_gain.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace covey {
namespace {

std::vector<GreyPair> pairs(std::mt19937& random, const GainOffset& truth, double noise,
                            int outliers) {
  std::normal_distribution<double> gaussian;
  std::vector<GreyPair> pairs;
  for (int i = 0; i < 200; ++i) {
    const double now = 128 + 40 * gaussian(random);
    GreyPair pair{now + noise * gaussian(random),
                  truth(now) + noise * truth.gain * gaussian(random)};
    if (i < outliers) pair.past += 90;
    pairs.push_back(pair);
  }
  return pairs;
}

TEST(GainOffsetFit, FindsGainAndOffsetWithAQuarterOutliers) {
  std::mt19937 random(1);
  const GainOffset truth{1.3, -20};
  const auto map = fit_gain_offset(pairs(random, truth, 0.5, 50), 20);
  ASSERT_TRUE(map);
  EXPECT_NEAR(map->gain, truth.gain, 0.005);
  EXPECT_NEAR((*map)(128), truth(128), 0.3);
}

// Ordinary regression would shrink the gain by 4 % in each image.
TEST(GainOffsetFit, NoiseInBothImagesDoesNotShrinkTheGain) {
  std::mt19937 random(2);
  double mean_log_gain = 0;
  constexpr int kTrials = 100;
  for (int i = 0; i < kTrials; ++i) {
    const auto map = fit_gain_offset(pairs(random, {0.8, 5}, 8, 0), 8);
    ASSERT_TRUE(map);
    mean_log_gain += std::log(map->gain / 0.8) / kTrials;
  }
  EXPECT_NEAR(mean_log_gain, 0, 0.006);
}

TEST(GainOffsetFit, SaysNothingWithoutContrastOrWithTooFewPairs) {
  EXPECT_FALSE(fit_gain_offset({{1, 2}, {3, 4}}, 8));
  EXPECT_FALSE(fit_gain_offset(std::vector<GreyPair>(50, {7, 9}), 8));
}

double no_field(const Eigen::Vector2d& /*pixel*/) { return 0; }

struct Scene {
  explicit Scene(unsigned seed) : random(seed) {}

  void add_track() {
    radiance.push_back(128 + 40 * gaussian(random));
    pixels.emplace_back(320 + 160 * gaussian(random), 256 + 128 * gaussian(random));
    ids.push_back(next_id++);
  }
  // Each image loses the oldest two of a hundred tracks.
  std::vector<TrackGrey> see(const GainOffset& to_first) {
    radiance.erase(radiance.begin(), radiance.begin() + 2);
    pixels.erase(pixels.begin(), pixels.begin() + 2);
    ids.erase(ids.begin(), ids.begin() + 2);
    add_track();
    add_track();
    std::vector<TrackGrey> seen;
    for (std::size_t i = 0; i < ids.size(); ++i) {
      const double grey = (radiance[i] - to_first.offset) / to_first.gain;
      seen.push_back({ids[i], pixels[i], grey + 0.5 * gaussian(random)});
    }
    return seen;
  }

  std::mt19937 random;
  std::normal_distribution<double> gaussian;
  std::vector<double> radiance;  // grey levels of the first image
  std::vector<Eigen::Vector2d> pixels;
  std::vector<std::uint64_t> ids;
  std::uint64_t next_id = 1;
};

TEST(TemporalGain, FollowsAnAutomaticGainForMinutesWithoutDrifting) {
  Scene scene(3);
  for (int i = 0; i < 100; ++i) scene.add_track();
  TemporalConfig config;
  config.relaxation_s = 600;
  TemporalGain gain(config);
  double worst_first_minute = 0, worst = 0;
  constexpr int kImages = 30 * 180;
  for (int k = 0; k < kImages; ++k) {
    const double t = k / 30.0;
    const GainOffset truth{
        std::exp(0.25 * std::sin(0.9 * t) + 0.02 * scene.gaussian(scene.random) * (k > 0 ? 1 : 0)),
        10 * std::sin(0.4 * t)};
    const GainOffset found = gain.add(nanoseconds(1 + t), scene.see(truth), no_field, {}, {});
    const double error = std::abs(std::log(found.gain / truth.gain));
    worst = std::max(worst, error);
    if (t < 60) worst_first_minute = std::max(worst_first_minute, error);
  }
  EXPECT_LT(worst_first_minute, 0.02);
  EXPECT_LT(worst, 0.03);
}

// What is learnt of the field between two images is not a change of gain between them.
TEST(TemporalGain, AFieldThatBecomesKnownDoesNotChangeTheGain) {
  const auto field = [](const Eigen::Vector2d& pixel) { return 0.2 * (pixel.x() - 320); };
  Scene scene(4);
  for (int i = 0; i < 100; ++i) scene.add_track();
  TemporalConfig config;
  config.relaxation_s = 1e6;
  TemporalGain gain(config);
  for (int k = 0; k < 60; ++k) {
    std::vector<TrackGrey> tracks = scene.see({});
    for (TrackGrey& track : tracks) track.grey += field(track.pixel);
    gain.add(nanoseconds(1 + k / 30.0), tracks, k < 30 ? FieldAt(no_field) : FieldAt(field), {},
             {});
  }
  EXPECT_NEAR(gain.latest().gain, 1, 0.02);
}

TEST(TemporalGain, KeepsTheLastMapWhenTooFewTracksAreShared) {
  TemporalGain gain{TemporalConfig{}};
  gain.restart({1.5, 3});
  EXPECT_DOUBLE_EQ(gain.add(nanoseconds(1), {}, no_field, {}, {1.5, 3}).gain, 1.5);
  EXPECT_DOUBLE_EQ(gain.estimate({{1, {5, 5}, 10}, {2, {9, 5}, 20}}, no_field, {}).gain, 1.5);
}

TEST(TemporalGain, IsPulledBackToItsAnchorSlowly) {
  TemporalConfig config;
  config.relaxation_s = 60;
  TemporalGain gain(config);
  gain.restart({1.5, 0});
  for (int k = 1; k <= 60; ++k) gain.add(nanoseconds(k), {{1, {5, 5}, 100}}, no_field, {}, {});
  EXPECT_NEAR(std::log(gain.latest().gain), std::log(1.5) * std::exp(-59.0 / 60), 1e-9);
}

// Minutes of a pull towards a mean that is not the truth do no harm then.
TEST(TemporalGain, ThePatternTellsItWhereTheAnchorIsWrong) {
  Scene scene(5);
  for (int i = 0; i < 100; ++i) scene.add_track();
  TemporalGain gain{TemporalConfig{}};
  const GainOffset truth{0.8, 5}, anchor{1.4, -40};
  gain.restart(truth);
  for (int k = 0; k < 300; ++k) {
    gain.add(nanoseconds(1 + k / 30.0), scene.see(truth), no_field,
             MeasuredGain{std::log(truth.gain), 0.005}, anchor);
  }
  EXPECT_NEAR(gain.latest().gain, truth.gain, 1e-9);
}

TEST(TemporalGain, APatternThatIsLessSureIsWeighed) {
  Scene scene(6);
  for (int i = 0; i < 100; ++i) scene.add_track();
  TemporalGain gain{TemporalConfig{}};
  gain.add(nanoseconds(1), scene.see({}), no_field, {}, {});
  const double told = 0.09, sigma = 2 * TemporalConfig{}.link_sigma;
  gain.add(nanoseconds(1.03), scene.see({}), no_field, MeasuredGain{told, sigma}, {});
  EXPECT_NEAR(std::log(gain.latest().gain), told / 5, 0.012);
}

TEST(TemporalGain, APatternThatTracksContradictIsNotBelieved) {
  Scene scene(7);
  for (int i = 0; i < 100; ++i) scene.add_track();
  TemporalGain gain{TemporalConfig{}};
  gain.add(nanoseconds(1), scene.see({}), no_field, {}, {});
  for (int k = 1; k <= 30; ++k) {
    gain.add(nanoseconds(1 + k / 30.0), scene.see({}), no_field, MeasuredGain{0.4, 0.005}, {});
    EXPECT_EQ(gain.contradictions(), k);
  }
  EXPECT_NEAR(gain.latest().gain, 1, 0.03);
  gain.add(nanoseconds(2.1), scene.see({}), no_field, MeasuredGain{0, 0.005}, {});
  EXPECT_EQ(gain.contradictions(), 0);
}

}  // namespace
}  // namespace covey
