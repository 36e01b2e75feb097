// SPDX-License-Identifier: Apache-2.0
#include "frontend/geometric_verification.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "offset_world.h"

namespace covey {
namespace {

using testing::level_camera;
using testing::offset_world;
using testing::OffsetWorld;
using testing::pinhole;
using testing::uniform;

TEST(OffsetsFromTwoPoints, OneOfTheSolutionsIsTheTruth) {
  int solved = 0;
  for (unsigned seed = 0; seed < 50; ++seed) {
    std::mt19937 random(seed);
    const FrameOffset truth{uniform(-3, 3, random),
                            {uniform(-20, 20, random), uniform(-20, 20, random), 4}};
    const OffsetWorld data = offset_world(truth, 2, 0, 100 + seed);
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
  OffsetWorld data = offset_world({0.05, {0.4, -0.3, 0.2}}, 30, 0.7, 5);
  const OffsetWorld wrong = offset_world({0.05, {0.4, -0.3, 0.2}}, 30, 0, 6);
  for (int i = 0; i < 15; ++i) {
    data.matches.push_back({wrong.matches[i].p_world_peer, wrong.matches[i + 15].bearing_own});
  }
  const VerificationResult result = verify(data.T_world_cam, data.matches, pinhole(), {});
  ASSERT_TRUE(result.verified.has_value());
  EXPECT_NEAR(result.verified->offset.yaw, 0.05, 0.003);
  EXPECT_LT((result.verified->offset.offset - data.truth.offset).norm(), 0.05);
  std::vector<std::size_t> expected(30);
  for (std::size_t i = 0; i < expected.size(); ++i) expected[i] = i;
  EXPECT_EQ(result.verified->inliers, expected);
}

// A wide lens shows a bearing at its edge smaller: a pixel is more of it there.
TEST(Verify, CountsPixelsAsTheLensShowsThem) {
  CameraIntrinsics wide = pinhole();
  wide.model = DistortionModel::kEquidistant;
  std::mt19937 random(8);
  OffsetWorld data = offset_world({}, 30, 0, 9);
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
  const OffsetWorld data = offset_world({0.0, {5, 0, 0}}, 30, 0.5, 7);
  const VerificationResult result = verify(data.T_world_cam, data.matches, pinhole(), {});
  EXPECT_FALSE(result.verified.has_value());
  EXPECT_EQ(result.failure, VerificationFailure::kOffsetTooLarge);
}

TEST(Verify, RefusesWorldsThatAreTurned) {
  const OffsetWorld data = offset_world({0.3, {0, 0, 0}}, 30, 0.5, 8);
  const VerificationResult result = verify(data.T_world_cam, data.matches, pinhole(), {});
  EXPECT_EQ(result.failure, VerificationFailure::kOffsetTooLarge);
}

TEST(Verify, RefusesPermutedMatches) {
  for (unsigned seed = 0; seed < 20; ++seed) {
    OffsetWorld data = offset_world({}, 40, 0.5, 20 + seed);
    for (std::size_t i = 0; i < 20; ++i) {
      std::swap(data.matches[i].bearing_own, data.matches[i + 20].bearing_own);
    }
    const VerificationResult result = verify(data.T_world_cam, data.matches, pinhole(), {});
    EXPECT_FALSE(result.verified.has_value()) << "seed " << seed;
  }
}

// METHOD: points normalised twice make a verification that accepts everything. Seven right matches
// are too few, whatever comes with them.
TEST(Verify, NeedsTheConfiguredNumberOfInliers) {
  const OffsetWorld seven = offset_world({}, 7, 0.3, 9), eight = offset_world({}, 8, 0.3, 9);
  EXPECT_EQ(verify(seven.T_world_cam, seven.matches, pinhole(), {}).failure,
            VerificationFailure::kTooFewCorrespondences);
  EXPECT_TRUE(verify(eight.T_world_cam, eight.matches, pinhole(), {}).verified.has_value());
}

TEST(Verify, PointsBehindTheCameraAreNoInliers) {
  OffsetWorld data = offset_world({}, 20, 0, 10);
  const Eigen::Vector3d c = data.T_world_cam.translation();
  for (Correspondence& match : data.matches) match.p_world_peer = 2 * c - match.p_world_peer;
  EXPECT_FALSE(verify(data.T_world_cam, data.matches, pinhole(), {}).verified.has_value());
}

TEST(Verify, SameInputSameOutput) {
  const OffsetWorld data = offset_world({0.02, {0.1, 0.2, 0}}, 25, 1.5, 11);
  const VerificationResult a = verify(data.T_world_cam, data.matches, pinhole(), {});
  const VerificationResult b = verify(data.T_world_cam, data.matches, pinhole(), {});
  ASSERT_TRUE(a.verified && b.verified);
  EXPECT_EQ(a.verified->inliers, b.verified->inliers);
  EXPECT_EQ(a.verified->offset.offset, b.verified->offset.offset);
}

TEST(Verify, TwentyPointsOnOneSpotDetermineNothing) {
  const Eigen::Isometry3d T_world_cam = level_camera({0, 0, 0});
  const std::vector<Correspondence> same(20, {{10, 1, 1}, {-0.1, -0.1}});
  EXPECT_EQ(verify(T_world_cam, same, pinhole(), {}).failure, VerificationFailure::kUndetermined);
}

}  // namespace
}  // namespace covey
