// SPDX-License-Identifier: Apache-2.0
//
// Where peers' worlds lie: unknown at first, wrong, or measured by hand.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "estimator/drift_filter.h"
#include "estimator/so3.h"
#include "sim/random.h"
#include "tests/estimator/drift_walk.h"

namespace covey {
namespace {

// The same walk in a world that is turned and far away.
Walk elsewhere(Walk walk, const Eigen::Isometry3d& T_peer_world) {
  Matrix6d turn = Matrix6d::Zero();
  turn.topLeftCorner<3, 3>() = turn.bottomRightCorner<3, 3>() = T_peer_world.linear();
  for (KeyframePose& pose : walk.keyframes) {
    pose.T_world_cam = T_peer_world * pose.T_world_cam;
    pose.covariance = turn * pose.covariance * turn.transpose();
  }
  return walk;
}

Eigen::Isometry3d far_away() {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.linear() = exp_so3({0, 0, 2.1});
  T.translation() = Eigen::Vector3d(300, -120, 40);
  return T;
}

DriftConfig unknown_start() {
  DriftConfig config;
  config.common_start = false;
  return config;
}

TEST(DriftFilter, AWorldIsFoundOnceSeveralPlacesAgree) {
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Walk own = walk(2 * seed, 30, {0, 0, 0});
    const Walk other = elsewhere(walk(2 * seed + 1, 30, {-3, 0, 0}), far_away());
    DriftFilter filter(unknown_start(), "uav0");
    int unaligned = 0;
    for (std::size_t i = 0; i < 30; ++i) {
      filter.add_own(own.keyframes[i]);
      unaligned +=
          filter.add(relative(own, i, other, i, 50 * seed + i)) == DriftOutcome::kUnaligned;
    }
    EXPECT_GE(unaligned, 3);
    EXPECT_LE(unaligned, 6);
    const auto alignment = filter.alignment("uav1");
    ASSERT_TRUE(alignment);
    const Eigen::Isometry3d error = far_away() * alignment->T_own_peer;
    const double position_m = (error * (far_away() * own.truth.back().translation()).eval() -
                               far_away() * own.truth.back().translation())
                                  .norm();
    EXPECT_LT(position_m, 0.35) << "the peer's drift included";
    EXPECT_LT(Eigen::AngleAxisd(error.linear()).angle(), 0.5 * M_PI / 180);
    EXPECT_LT(alignment->position_sigma, 0.2);
  }
}

// Two halls that look alike, 12 m apart: what is seen in one is taken for the other.
TEST(DriftFilter, AWorldSeenFromOneSpotOnlyIsNotBelieved) {
  const Walk own = walk(1, 30, {0, 0, 0});
  Walk other = elsewhere(walk(2, 30, {-3, 0, 0}), far_away());
  DriftFilter filter(unknown_start(), "uav0");
  // Four keyframes within 3 m of flight, all agreeing on the wrong hall.
  for (std::size_t i = 0; i < 4; ++i) {
    RelativePose aliased = relative(own, i, other, i, i);
    aliased.T_other_own.translation().x() += 12;
    EXPECT_EQ(filter.add(aliased), DriftOutcome::kUnaligned);
  }
  EXPECT_FALSE(filter.alignment("uav1"));
  // What is seen afterwards is the truth, and wins once it is most of what was said.
  for (std::size_t i = 5; i < 30; ++i) (void)filter.add(relative(own, i, other, i, i));
  const auto alignment = filter.alignment("uav1");
  ASSERT_TRUE(alignment);
  const Eigen::Vector3d p = own.truth.back().translation();
  EXPECT_LT((alignment->T_own_peer * (far_away() * p).eval() - p).norm(), 0.35);
}

TEST(DriftFilter, MatchesThatDisagreeNeverAlignWorlds) {
  const Walk own = walk(1, 60, {0, 0, 0});
  const Walk other = elsewhere(walk(2, 60, {-3, 0, 0}), far_away());
  DriftFilter filter(unknown_start(), "uav0");
  Random random(4, 1);
  for (std::size_t i = 0; i < 60; ++i) {
    RelativePose aliased = relative(own, i, other, 59 - i, i);
    aliased.T_other_own.translation() += 8 * random.gaussian_vector();
    EXPECT_EQ(filter.add(aliased), DriftOutcome::kUnaligned);
  }
}

TEST(DriftFilter, AWorldThatIsTiltedIsNone) {
  const Walk own = walk(1, 30, {0, 0, 0});
  Eigen::Isometry3d tilted = far_away();
  tilted.linear() = exp_so3({0.1, 0, 0}) * tilted.linear();
  const Walk other = elsewhere(walk(2, 30, {-3, 0, 0}), tilted);
  DriftFilter filter(unknown_start(), "uav0");
  for (std::size_t i = 0; i < 30; ++i) {
    EXPECT_EQ(filter.add(relative(own, i, other, i, i)), DriftOutcome::kUnaligned);
  }
}

// ------------------------------------------------------------------------ worlds that were wrong

// How far off the other's newest keyframe is put, its drift included.
double misplaced_m(const DriftFilter& filter, const Walk& other, std::size_t last) {
  const std::optional<WorldAlignment> found = filter.alignment("uav1");
  if (!found) return std::numeric_limits<double>::infinity();
  return (found->T_own_peer * other.keyframes[last].T_world_cam.translation() -
          other.truth[last].translation())
      .norm();
}

// Of the own position, corrected, at the last keyframe.
double position_nees(const DriftFilter& filter, const Walk& own) {
  const Odometry corrected = filter.corrected(odometry_at(own.keyframes.back()));
  const Eigen::Vector3d error = own.truth.back().translation() - corrected.pose.p_world_imu;
  const Eigen::Matrix3d P = corrected.pose_covariance.topLeftCorner<3, 3>();
  return error.dot(P.ldlt().solve(error));
}

// A row of halls that are all the same: the next one is taken for the first as long as the drones
// are in those, and every pose agrees.
TEST(DriftFilter, AFalseAlignmentIsTakenBack) {
  double nees = 0;
  constexpr int kSeeds = 8;
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    const Walk own = walk(2 * seed, 40, {0, 0, 0});
    const Walk other = elsewhere(walk(2 * seed + 1, 40, {-3, 0, 0}), far_away());
    DriftFilter filter(unknown_start(), "uav0");
    int moved = 0;
    for (std::size_t i = 0; i < 40; ++i) {
      filter.add_own(own.keyframes[i]);
      RelativePose pose = relative(own, i, other, i, 50 * seed + i);
      if (i < 12) pose.T_other_own.translation().x() += 12;
      moved += filter.add(pose) == DriftOutcome::kMoved ? 1 : 0;
      if (i == 11) {
        EXPECT_GT(misplaced_m(filter, other, i), 11) << "it looks so to everybody";
      }
    }
    EXPECT_EQ(moved, 1);
    EXPECT_EQ(filter.moves("uav1"), 1);
    EXPECT_LT(misplaced_m(filter, other, 39), 0.5) << "drift of both included";
    EXPECT_GT(least_eigenvalue(filter), 0);
    nees += position_nees(filter, own) / kSeeds;
  }
  EXPECT_LT(nees, 2 * 3) << "the own drone is hardly the worse for it";
}

TEST(DriftFilter, APeerThatDoesNotStartWhereItSaysIsFoundWhereItDoes) {
  Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
  T.translation().x() = 1.5;
  T.linear() = exp_so3({0, 0, 0.02});
  const Walk own = walk(1, 40, {0, 0, 0}), other = elsewhere(walk(2, 40, {-3, 0, 0}), T);
  DriftFilter filter({}, "uav0");
  std::size_t first_used = 0;
  for (std::size_t i = 0; i < 40; ++i) {
    filter.add_own(own.keyframes[i]);
    const DriftOutcome outcome = filter.add(relative(own, i, other, i, i));
    if (first_used > 0) {
      EXPECT_NE(outcome, DriftOutcome::kMoved);
    } else if (outcome == DriftOutcome::kMoved) {
      first_used = i;
    } else {
      EXPECT_EQ(outcome, DriftOutcome::kGated);
      EXPECT_EQ(filter.keyframes(), 0);
    }
  }
  EXPECT_GE(first_used, 4u) << "views must differ by 0.4 rad, 4 m at that depth";
  EXPECT_LE(first_used, 6u);
  EXPECT_LT(misplaced_m(filter, other, 39), 0.3);
}

// By hand, drones are put where they say to a few centimetres and degrees. Taken for exact, the
// difference is taken for drift of both.
TEST(DriftFilter, StartsThatAreMeasuredByHandDoTheOwnDroneNoHarm) {
  constexpr int kSeeds = 20;
  double alone = 0, exact = 0, measured = 0, nees = 0;
  for (std::uint64_t seed = 0; seed < kSeeds; ++seed) {
    Random random(seed, 0x57a);
    DriftConfig config;
    config.start_position_sigma_m = 0.05;
    config.start_yaw_sigma = 0.02;
    Eigen::Isometry3d T = Eigen::Isometry3d::Identity();
    T.translation() = config.start_position_sigma_m * random.gaussian_vector();
    T.linear() = exp_so3({0, 0, config.start_yaw_sigma * random.gaussian()});
    const Walk own = walk(2 * seed, 40, {0, 0, 0});
    const Walk other = elsewhere(walk(2 * seed + 1, 40, {-3, 0, 0}), T);
    DriftFilter believes({}, "uav0"), knows(config, "uav0");
    for (std::size_t i = 0; i < 40; ++i) {
      believes.add_own(own.keyframes[i]);
      knows.add_own(own.keyframes[i]);
      if (i % 3 != 0) continue;
      (void)believes.add(relative(own, i, other, i, 50 * seed + i));
      EXPECT_NE(knows.add(relative(own, i, other, i, 50 * seed + i)), DriftOutcome::kMoved);
    }
    const Odometry last = odometry_at(own.keyframes.back());
    const Eigen::Vector3d truth = own.truth.back().translation();
    alone += (last.pose.p_world_imu - truth).squaredNorm();
    exact += (believes.corrected(last).pose.p_world_imu - truth).squaredNorm();
    measured += (knows.corrected(last).pose.p_world_imu - truth).squaredNorm();
    nees += position_nees(knows, own) / kSeeds;
  }
  EXPECT_LT(measured, 0.9 * exact);
  EXPECT_LT(measured, 0.7 * alone);
  EXPECT_GT(nees, 0.5 * 3);
  EXPECT_LT(nees, 1.5 * 3);
}

TEST(DriftFilter, WhatFitsKeepsTheWorldWhereItIs) {
  const Walk own = walk(1, 60, {0, 0, 0}), other = walk(2, 60, {-3, 0, 0});
  DriftFilter filter({}, "uav0");
  for (std::size_t i = 0; i < 60; ++i) {
    filter.add_own(own.keyframes[i]);
    const RelativePose pose = relative(own, i, other, i, i);
    EXPECT_NE(filter.add(i % 4 == 3 ? pose : five_metres_off(pose)), DriftOutcome::kMoved);
  }
  EXPECT_EQ(filter.moves("uav1"), 0);
  EXPECT_LT(misplaced_m(filter, other, 59), 0.3);
}

TEST(DriftFilter, WhoMovesOnAndOnIsNotBelieved) {
  const Walk own = walk(1, 100, {0, 0, 0}), honest = walk(2, 100, {-3, 0, 0});
  DriftConfig config;
  DriftFilter filter(config, "uav0");
  for (std::size_t i = 0; i < 100; ++i) {
    filter.add_own(own.keyframes[i]);
    RelativePose pose = relative(own, i, honest, i, i);
    pose.T_other_own.translation().x() += 3.0 * static_cast<double>(i / 10);
    (void)filter.add(pose);
  }
  EXPECT_EQ(filter.moves("uav1"), config.max_moves);
  EXPECT_EQ(filter.add(five_metres_off(relative(own, 99, honest, 99, 7))), DriftOutcome::kGated);
}

TEST(DriftFilter, TheOwnWorldStaysWhereItIs) {
  const Walk own = walk(1, 60, {0, 0, 0});
  DriftFilter filter({}, "uav0");
  for (const KeyframePose& pose : own.keyframes) filter.add_own(pose);
  for (std::size_t i = 30; i < 60; ++i) {
    const RelativePose pose = five_metres_off(relative(own, i, own, i - 30, i, "uav0"));
    EXPECT_EQ(filter.add(pose), DriftOutcome::kGated);
  }
  EXPECT_EQ(filter.moves("uav0"), 0);
}

}  // namespace
}  // namespace covey
