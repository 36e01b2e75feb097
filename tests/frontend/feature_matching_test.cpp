// SPDX-License-Identifier: Apache-2.0
#include "frontend/feature_matching.h"

#include <gtest/gtest.h>

#include <random>

#include "offset_world.h"

namespace covey {
namespace {

using testing::kPinholeFocal;
using testing::offset_world;
using testing::OffsetWorld;
using testing::pinhole;

ShortDescriptor random_descriptor(std::mt19937& random) {
  ShortDescriptor descriptor{};
  for (std::uint8_t& byte : descriptor) byte = static_cast<std::uint8_t>(random());
  return descriptor;
}

// `bits` draws of a bit to flip; a bit drawn twice flips back.
ShortDescriptor with_noise(ShortDescriptor descriptor, int bits, std::mt19937& random) {
  for (int i = 0; i < bits; ++i) {
    const auto bit = random() % (8 * descriptor.size());
    descriptor[bit / 8] ^= static_cast<std::uint8_t>(1 << (bit % 8));
  }
  return descriptor;
}

TEST(MatchDescriptors, FindsTheSameDescriptorsUnderBitNoiseAndNothingElse) {
  std::mt19937 random(1);
  std::vector<ShortDescriptor> own, peer;
  for (int i = 0; i < 60; ++i) own.push_back(random_descriptor(random));
  for (int i = 0; i < 30; ++i) peer.push_back(with_noise(own[2 * i], 5, random));
  for (int i = 0; i < 30; ++i) peer.push_back(random_descriptor(random));
  const std::vector<IndexPair> pairs = match_descriptors(own, peer, {});
  EXPECT_EQ(pairs.size(), 30u);
  for (const IndexPair& pair : pairs) EXPECT_EQ(pair.own, 2 * pair.peer);
}

TEST(MatchDescriptors, TwinsAreAmbiguousOnEitherSide) {
  std::mt19937 random(2);
  const ShortDescriptor a = random_descriptor(random), b = random_descriptor(random);
  EXPECT_TRUE(match_descriptors({a, a}, {a, b}, {}).empty());
  EXPECT_TRUE(match_descriptors({a, b}, {a, a}, {}).empty());
  EXPECT_EQ(match_descriptors({a, b}, {b, a}, {}).size(), 2u);
}

TEST(MatchDescriptors, EmptySidesMatchNothing) {
  std::mt19937 random(3);
  EXPECT_TRUE(match_descriptors({}, {}, {}).empty());
  EXPECT_TRUE(match_descriptors({random_descriptor(random)}, {}, {}).empty());
}

TEST(MutualMatches, NearestMustAgreeOnBothSides) {
  MutualMatches matches(2, 2);
  matches.see(0, 0, 5);
  matches.see(1, 0, 3);  // takes peer 0 from own 0
  matches.see(0, 1, 9);
  const std::vector<IndexPair> pairs = matches.pairs(100, 0.9);
  ASSERT_EQ(pairs.size(), 1u);
  EXPECT_EQ(pairs[0].own, 1u);
  EXPECT_EQ(pairs[0].peer, 0u);
  EXPECT_TRUE(matches.pairs(2, 0.9).empty()) << "too far";
}

// Features whose descriptors changed by about 17 bits, which no ratio test would let through.
struct GuidedCase {
  OffsetWorld data;
  std::vector<OwnFeature> own;
  std::vector<PeerPoint> peer;
};

GuidedCase make_guided_case(unsigned seed) {
  std::mt19937 random(seed);
  GuidedCase result;
  result.data = offset_world({0.03, {0.3, -0.2, 0.1}}, 40, 0.5, seed);
  for (const Correspondence& match : result.data.matches) {
    const ShortDescriptor descriptor = random_descriptor(random);
    result.own.push_back({match.bearing_own, with_noise(descriptor, 20, random)});
    result.peer.push_back({match.p_world_peer, descriptor});
  }
  return result;
}

std::vector<IndexPair> guided(const GuidedCase& c, const FrameOffset& offset) {
  return match_guided(c.data.T_world_cam, offset, c.own, c.peer, pinhole(), {});
}

TEST(MatchGuided, FindsWhatDescriptorsAloneCannot) {
  const GuidedCase c = make_guided_case(31);
  const std::vector<IndexPair> pairs = guided(c, c.data.truth);
  EXPECT_GE(pairs.size(), 36u);
  for (const IndexPair& pair : pairs) EXPECT_EQ(pair.own, pair.peer);
}

TEST(MatchGuided, NeedsBothThePlaceAndTheDescriptor) {
  GuidedCase c = make_guided_case(32);
  EXPECT_LE(guided(c, {0.03, {0.8, -0.2, 0.1}}).size(), 2u) << "the wrong offset";
  std::mt19937 random(33);
  for (PeerPoint& point : c.peer) point.descriptor = random_descriptor(random);
  EXPECT_LE(guided(c, c.data.truth).size(), 2u) << "other corners in the same places";
}

TEST(MatchNearest, NeedsThePlaceAlone) {
  GuidedCase c = make_guided_case(34);
  for (PeerPoint& point : c.peer) point.descriptor = {};
  const auto nearest = [&](const FrameOffset& offset) {
    return match_nearest(c.data.T_world_cam, offset, c.own, c.peer, pinhole(), {});
  };
  const std::vector<IndexPair> pairs = nearest(c.data.truth);
  EXPECT_GE(pairs.size(), 36u);
  for (const IndexPair& pair : pairs) EXPECT_EQ(pair.own, pair.peer);
  EXPECT_LE(nearest({0.03, {0.8, -0.2, 0.1}}).size(), 2u) << "the wrong offset";
}

// Of two own corners in reach the nearer one, and of two landmarks on one corner as well.
TEST(MatchNearest, TakesWhatLiesNearest) {
  const double px = 1 / kPinholeFocal;
  const Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();  // looks up
  const std::vector<OwnFeature> own = {{{1.5 * px, 0}, {}}, {{0.2 * px, 0}, {}}};
  const std::vector<PeerPoint> peer = {{{0, 0, 1}, {}}, {{0.9 * px, 0, 1}, {}}};
  const std::vector<IndexPair> pairs = match_nearest(T_world_cam, {}, own, peer, pinhole(), {});
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].own, 0u);
  EXPECT_EQ(pairs[0].peer, 1u);
  EXPECT_EQ(pairs[1].own, 1u);
  EXPECT_EQ(pairs[1].peer, 0u);
}

}  // namespace
}  // namespace covey
