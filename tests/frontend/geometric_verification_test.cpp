// SPDX-License-Identifier: Apache-2.0
#include "frontend/matching.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "synthetic_places.h"

namespace covey {
namespace {

using testing::level_camera;
using testing::uniform;

constexpr double kFocal = 455;  // px

CameraIntrinsics camera() {
  CameraIntrinsics camera;
  camera.fx = camera.fy = kFocal;
  return camera;
}

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

// A peer whose world is off by a known yaw and translation, seen by a camera that is not level.
struct Case {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  FrameOffset truth;
  std::vector<Correspondence> matches;
};

Case make_case(const FrameOffset& truth, int points, double noise_px, unsigned seed) {
  std::mt19937 random(seed);
  Case result;
  result.T_world_cam = level_camera({3, -2, 1}, 0.4);
  result.T_world_cam.linear() =
      result.T_world_cam.linear() * Eigen::AngleAxisd(0.2, Eigen::Vector3d(1, 2, 0).normalized());
  result.truth = truth;
  const Eigen::Vector3d c = result.T_world_cam.translation();
  for (int i = 0; i < points; ++i) {
    const Eigen::Vector2d bearing(uniform(-0.7, 0.7, random), uniform(-0.5, 0.5, random));
    const Eigen::Vector3d p_own =
        result.T_world_cam * (uniform(5, 20, random) * bearing.homogeneous());
    const Eigen::Vector2d noise(uniform(-1, 1, random), uniform(-1, 1, random));
    // The inverse of to_own_world.
    const Eigen::Vector3d p_peer =
        c + Eigen::AngleAxisd(-truth.yaw, Eigen::Vector3d::UnitZ()) * (p_own - c - truth.offset);
    result.matches.push_back({p_peer, bearing + noise_px / kFocal * noise});
  }
  return result;
}

TEST(OffsetsFromTwoPoints, OneOfTheSolutionsIsTheTruth) {
  int solved = 0;
  for (unsigned seed = 0; seed < 50; ++seed) {
    std::mt19937 random(seed);
    const FrameOffset truth{uniform(-3, 3, random),
                            {uniform(-20, 20, random), uniform(-20, 20, random), 4}};
    const Case data = make_case(truth, 2, 0, 100 + seed);
    const auto offsets =
        offsets_from_two_points(data.T_world_cam, data.matches[0], data.matches[1]);
    ASSERT_LE(offsets.size(), 2u);
    solved += std::any_of(offsets.begin(), offsets.end(), [&](const FrameOffset& offset) {
      return std::abs(offset.yaw - truth.yaw) < 1e-6 &&
             (offset.offset - truth.offset).norm() < 1e-5;
    });
  }
  EXPECT_EQ(solved, 50);
}

TEST(OffsetsFromTwoPoints, DegeneratePairsGiveNothing) {
  const Eigen::Isometry3d T_world_cam = level_camera({0, 0, 0});
  const Correspondence level{{10, 0, 0}, {0, 0}}, also_level{{10, 1, 0}, {-0.1, 0}};
  EXPECT_TRUE(offsets_from_two_points(T_world_cam, level, also_level).empty());
  const Correspondence up{{10, 0, 2}, {0, -0.2}};
  EXPECT_TRUE(offsets_from_two_points(T_world_cam, up, up).empty());
}

TEST(Verify, FindsTheOffsetAndExactlyTheRightMatchesAmongWrongOnes) {
  Case data = make_case({0.05, {0.4, -0.3, 0.2}}, 30, 0.7, 5);
  const Case wrong = make_case({0.05, {0.4, -0.3, 0.2}}, 30, 0, 6);
  for (int i = 0; i < 15; ++i) {
    data.matches.push_back({wrong.matches[i].p_world_peer, wrong.matches[i + 15].bearing_own});
  }
  const VerificationResult result = verify(data.T_world_cam, data.matches, camera(), {});
  ASSERT_TRUE(result.verified.has_value());
  EXPECT_NEAR(result.verified->offset.yaw, 0.05, 0.003);
  EXPECT_LT((result.verified->offset.offset - data.truth.offset).norm(), 0.05);
  std::vector<std::size_t> expected(30);
  for (std::size_t i = 0; i < expected.size(); ++i) expected[i] = i;
  EXPECT_EQ(result.verified->inliers, expected);
}

// A wide lens shows a bearing at its edge smaller: a pixel is more of it there.
TEST(Verify, CountsPixelsAsTheLensShowsThem) {
  CameraIntrinsics wide = camera();
  wide.model = DistortionModel::kEquidistant;
  std::mt19937 random(8);
  Case data = make_case({}, 30, 0, 9);
  for (Correspondence& match : data.matches) {
    const Eigen::Vector3d p_cam = data.T_world_cam.inverse() * match.p_world_peer;
    match.bearing_own = 1.8 / 0.7 * p_cam.hnormalized();  // up to 61 degrees off the axis
    const double depth = p_cam.z();
    match.p_world_peer = data.T_world_cam * (depth * match.bearing_own.homogeneous()).eval();
    const Eigen::Vector2d off_px(uniform(-1.2, 1.2, random), uniform(-1.2, 1.2, random));
    match.bearing_own += px_per_bearing(wide, match.bearing_own).inverse() * off_px;
  }
  const VerificationResult result = verify(data.T_world_cam, data.matches, wide, {2.0});
  ASSERT_TRUE(result.verified.has_value());
  EXPECT_EQ(result.verified->inliers.size(), data.matches.size());
}

TEST(Verify, RefusesWorldsThatAreFiveMetresApart) {
  const Case data = make_case({0.0, {5, 0, 0}}, 30, 0.5, 7);
  const VerificationResult result = verify(data.T_world_cam, data.matches, camera(), {});
  EXPECT_FALSE(result.verified.has_value());
  EXPECT_EQ(result.failure, VerificationFailure::kOffsetTooLarge);
}

TEST(Verify, RefusesWorldsThatAreTurned) {
  const Case data = make_case({0.3, {0, 0, 0}}, 30, 0.5, 8);
  const VerificationResult result = verify(data.T_world_cam, data.matches, camera(), {});
  EXPECT_EQ(result.failure, VerificationFailure::kOffsetTooLarge);
}

TEST(Verify, RefusesPermutedMatches) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    Case data = make_case({}, 40, 0.5, 20 + seed);
    for (std::size_t i = 0; i < 20; ++i) {
      std::swap(data.matches[i].bearing_own, data.matches[i + 20].bearing_own);
    }
    const VerificationResult result = verify(data.T_world_cam, data.matches, camera(), {});
    EXPECT_FALSE(result.verified.has_value()) << "seed " << seed;
  }
}

// METHOD: points normalised twice make a verification that accepts everything. Seven right matches
// are too few, whatever comes with them.
TEST(Verify, NeedsTheConfiguredNumberOfInliers) {
  const Case seven = make_case({}, 7, 0.3, 9), eight = make_case({}, 8, 0.3, 9);
  EXPECT_EQ(verify(seven.T_world_cam, seven.matches, camera(), {}).failure,
            VerificationFailure::kTooFewCorrespondences);
  EXPECT_TRUE(verify(eight.T_world_cam, eight.matches, camera(), {}).verified.has_value());
}

TEST(Verify, PointsBehindTheCameraAreNoInliers) {
  Case data = make_case({}, 20, 0, 10);
  const Eigen::Vector3d c = data.T_world_cam.translation();
  for (Correspondence& match : data.matches) match.p_world_peer = 2 * c - match.p_world_peer;
  EXPECT_FALSE(verify(data.T_world_cam, data.matches, camera(), {}).verified.has_value());
}

TEST(Verify, SameInputSameOutput) {
  const Case data = make_case({0.02, {0.1, 0.2, 0}}, 25, 1.5, 11);
  const VerificationResult a = verify(data.T_world_cam, data.matches, camera(), {});
  const VerificationResult b = verify(data.T_world_cam, data.matches, camera(), {});
  ASSERT_TRUE(a.verified && b.verified);
  EXPECT_EQ(a.verified->inliers, b.verified->inliers);
  EXPECT_EQ(a.verified->offset.offset, b.verified->offset.offset);
}

TEST(Verify, TwentyPointsOnOneSpotDetermineNothing) {
  const Eigen::Isometry3d T_world_cam = level_camera({0, 0, 0});
  const std::vector<Correspondence> same(20, {{10, 1, 1}, {-0.1, -0.1}});
  EXPECT_EQ(verify(T_world_cam, same, camera(), {}).failure, VerificationFailure::kUndetermined);
}

// Features whose descriptors changed by about 17 bits, which no ratio test would let through.
struct GuidedCase {
  Case data;
  std::vector<OwnFeature> own;
  std::vector<PeerPoint> peer;
};

GuidedCase make_guided_case(unsigned seed) {
  std::mt19937 random(seed);
  GuidedCase result;
  result.data = make_case({0.03, {0.3, -0.2, 0.1}}, 40, 0.5, seed);
  for (const Correspondence& match : result.data.matches) {
    const ShortDescriptor descriptor = random_descriptor(random);
    result.own.push_back({match.bearing_own, with_noise(descriptor, 20, random)});
    result.peer.push_back({match.p_world_peer, descriptor});
  }
  return result;
}

std::vector<IndexPair> guided(const GuidedCase& c, const FrameOffset& offset) {
  return match_guided(c.data.T_world_cam, offset, c.own, c.peer, camera(), {});
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
    return match_nearest(c.data.T_world_cam, offset, c.own, c.peer, camera(), {});
  };
  const std::vector<IndexPair> pairs = nearest(c.data.truth);
  EXPECT_GE(pairs.size(), 36u);
  for (const IndexPair& pair : pairs) EXPECT_EQ(pair.own, pair.peer);
  EXPECT_LE(nearest({0.03, {0.8, -0.2, 0.1}}).size(), 2u) << "the wrong offset";
}

// Of two own corners in reach the nearer one, and of two landmarks on one corner as well.
TEST(MatchNearest, TakesWhatLiesNearest) {
  const double px = 1 / kFocal;
  const Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();  // looks up
  const std::vector<OwnFeature> own = {{{1.5 * px, 0}, {}}, {{0.2 * px, 0}, {}}};
  const std::vector<PeerPoint> peer = {{{0, 0, 1}, {}}, {{0.9 * px, 0, 1}, {}}};
  const std::vector<IndexPair> pairs = match_nearest(T_world_cam, {}, own, peer, camera(), {});
  ASSERT_EQ(pairs.size(), 2u);
  EXPECT_EQ(pairs[0].own, 0u);
  EXPECT_EQ(pairs[0].peer, 1u);
  EXPECT_EQ(pairs[1].own, 1u);
  EXPECT_EQ(pairs[1].peer, 0u);
}

}  // namespace
}  // namespace covey
