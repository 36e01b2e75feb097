// SPDX-License-Identifier: Apache-2.0
#include "apps/start_doubt.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace covey {
namespace {

PeerCounts counts(std::int64_t fused, std::int64_t gated) {
  PeerCounts counts;
  counts.fused = fused;
  counts.gated = gated;
  counts.rejected = 1000;  // for any reason, of which most say nothing of the start
  return counts;
}

CollaboratorReport not_found(int matches, int inliers, int offset) {
  CollaboratorReport report;
  report.no_match[static_cast<std::size_t>(NoMatchReason::kTooFewMatches)] = matches;
  report.no_match[static_cast<std::size_t>(NoMatchReason::kTooFewInliers)] = inliers;
  report.no_match[static_cast<std::size_t>(NoMatchReason::kOffsetTooLarge)] = offset;
  report.no_match[static_cast<std::size_t>(NoMatchReason::kUnknownRequest)] = 1000;
  return report;
}

TEST(StartDoubt, ComesOnceHardlyAnyAnswerFits) {
  EXPECT_THAT(
      doubt_of_start(counts(0, 2), not_found(3, 2, 1)).value_or(""),
      ::testing::AllOf(::testing::StartsWith("0 of 8 answers of other drones fit"),
                       ::testing::HasSubstr("x_m"), ::testing::HasSubstr("--unknown-start")));
  EXPECT_FALSE(doubt_of_start(counts(0, 2), not_found(3, 2, 0))) << "too few to tell";
  EXPECT_TRUE(doubt_of_start(counts(2, 0), not_found(20, 0, 0)));
  EXPECT_FALSE(doubt_of_start(counts(3, 0), not_found(20, 0, 0)));
  EXPECT_FALSE(doubt_of_start(counts(0, 0), not_found(0, 0, 0)));
}

// Seen from uav0, which looks to the east from (0, i); both see 10 m deep.
RelativePose seen(std::uint64_t i, double misplaced_m) {
  RelativePose pose;
  pose.drone = "uav1";
  pose.own.keyframe_id = pose.other.keyframe_id = i;
  pose.own.stamp_ns = pose.other.stamp_ns = nanoseconds(static_cast<double>(i));
  pose.own.T_world_cam.translation().y() = static_cast<double>(i);
  pose.other = pose.own;
  pose.other.T_world_cam.translation().x() += misplaced_m;
  pose.own.covariance = pose.other.covariance = 1e-4 * Matrix6d::Identity();
  pose.own_before = pose.own;
  pose.other_before = pose.other;
  pose.own_mean_depth = 10;
  pose.covariance = 1e-4 * Matrix6d::Identity();
  return pose;
}

TEST(StartDoubt, TellsWhereAPeersWorldHasBeenFound) {
  DriftFilter team({}, "uav0");
  for (std::uint64_t i = 1; i <= 8; ++i) (void)team.add(seen(i, 2));
  ASSERT_EQ(team.moves("uav1"), 1);
  EXPECT_EQ(words_on_move("uav1", team),
            "uav1's world lies elsewhere than was believed: common places have it 2.00 m and 0.0 "
            "degrees from the own one");
  team.forget_drone("uav1");
  EXPECT_THAT(words_on_move("uav1", team), ::testing::EndsWith("nothing more is known of it"));
}

}  // namespace
}  // namespace covey
