// SPDX-License-Identifier: Apache-2.0
#include "estimator/drift_filter.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <array>
#include <cmath>
#include <limits>

#include "sim/random.h"
#include "tests/estimator/drift_walk.h"

namespace covey {
namespace {

TEST(DriftFilter, WithoutPeersTheOdometryStaysAsItIs) {
  DriftFilter filter({}, "uav0");
  const Odometry alone = odometry_at(walk(1, 5, {0, 0, 0}).keyframes.back());
  EXPECT_EQ(filter.corrected(alone).pose.p_world_imu, alone.pose.p_world_imu);
  EXPECT_FALSE(filter.alignment("uav1"));
}

TEST(DriftFilter, TwoDronesTogetherAreBetterThanEachAlone) {
  double alone = 0, together = 0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const Walk own = walk(2 * seed, 60, {0, 0, 0}), other = walk(2 * seed + 1, 60, {-3, 0, 0});
    DriftFilter filter({}, "uav0");
    for (std::size_t i = 0; i < 60; ++i) {
      filter.add_own(own.keyframes[i]);
      if (i % 4 == 0) (void)filter.add(relative(own, i, other, i, 100 * seed + i));
    }
    const Odometry last = odometry_at(own.keyframes.back());
    const Eigen::Vector3d truth = own.truth.back().translation();
    alone += (last.pose.p_world_imu - truth).squaredNorm();
    together += (filter.corrected(last).pose.p_world_imu - truth).squaredNorm();
  }
  EXPECT_LT(together, 0.75 * alone);
}

// The share by which odometry has the way from -> to too short.
double too_short(const Walk& walk, std::size_t from, std::size_t to) {
  const auto way = [&](std::size_t i, std::size_t j) {
    return Eigen::Vector3d(walk.keyframes[j].T_world_cam.translation() -
                           walk.keyframes[i].T_world_cam.translation());
  };
  const Eigen::Vector3d truth = walk.truth[to].translation() - walk.truth[from].translation();
  return (truth - way(from, to)).dot(way(from, to)) / way(from, to).squaredNorm();
}

// As relative(), but the other's depths, and with them the way between the two, are as wrong as its
// odometry since six keyframes before, and both drones' depths were compared.
RelativePose compared(const Walk& own, std::size_t i, const Walk& other, std::size_t j,
                      std::uint64_t seed) {
  constexpr double kSigma = 5e-4;
  Random random(seed, 0x5ca1e);
  RelativePose pose = relative(own, i, other, j, seed);
  pose.T_other_own.translation() *= 1 - too_short(other, j - 6, j);
  DepthRatio ratio;
  pose.own_before = own.keyframes[i - 6];
  ratio.log_ratio =
      too_short(own, i - 6, i) - too_short(other, j - 6, j) + kSigma * random.gaussian();
  ratio.variance = kSigma * kSigma;
  pose.depth_ratio = ratio;
  return pose;
}

// From afar a relative pose says little of what the scale of the depths has done to it.
TEST(DriftFilter, ComparedDepthsTellWhoseOdometryIsWrong) {
  double without = 0, with = 0, nees = 0;
  constexpr int kRuns = 60, kComparisons = 18;
  int used = 0;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    const Walk own = walk(2 * seed, 60, {0, 0, 0}), other = walk(2 * seed + 1, 60, {-10, 0, 0});
    DriftFilter plain({}, "uav0"), comparing({}, "uav0");
    for (std::size_t i = 6; i < 60; ++i) {
      plain.add_own(own.keyframes[i]);
      comparing.add_own(own.keyframes[i]);
      if (i % 3 != 0) continue;
      RelativePose measured = compared(own, i, other, i, 100 * seed + i);
      used += comparing.add(measured) == DriftOutcome::kUsed;
      measured.depth_ratio.reset();
      (void)plain.add(measured);
    }
    const Odometry last = odometry_at(own.keyframes.back());
    const Eigen::Vector3d truth = own.truth.back().translation();
    const Odometry better = comparing.corrected(last);
    const Eigen::Vector3d error = better.pose.p_world_imu - truth;
    without += (plain.corrected(last).pose.p_world_imu - truth).squaredNorm();
    with += error.squaredNorm();
    nees += error.dot(better.pose_covariance.topLeftCorner<3, 3>().llt().solve(error));
    EXPECT_GT(least_eigenvalue(comparing), 0);
  }
  EXPECT_GT(used, 0.99 * kRuns * kComparisons) << "one in a thousand is gated by chance";
  EXPECT_LT(with, 0.9 * without);
  EXPECT_NEAR(nees / kRuns, 3.0, 1.0);
}

// The own drone is followed by another, which comes by each of its places six keyframes later and
// finds it, and tells.
TEST(DriftFilter, WhatAPeerHasFoundHelpsTheOneItFollowsToo) {
  double alone = 0, together = 0, nees = 0;
  constexpr int kRuns = 60;
  int used = 0, told = 0;
  for (std::uint64_t seed = 0; seed < kRuns; ++seed) {
    const Walk own = walk(2 * seed, 60, {0, 0, 0}), other = walk(2 * seed + 1, 60, {-3, 0, 0});
    DriftFilter filter({}, "uav0");
    for (std::size_t i = 0; i < 60; ++i) {
      filter.add_own(own.keyframes[i]);
      if (i < 12 || i % 3 != 0) continue;
      const RelativePose found = compared(other, i, own, i - 6, 100 * seed + i);
      RelativePose by_peer = found;
      by_peer.drone = "uav0";
      ++told;
      used += filter.add(found_by_peer(as_told(by_peer, "uav1"), found.other, found.other_before,
                                       kDepth_m)) == DriftOutcome::kUsed;
    }
    const Odometry last = odometry_at(own.keyframes.back());
    const Eigen::Vector3d truth = own.truth.back().translation();
    const Odometry better = filter.corrected(last);
    const Eigen::Vector3d error = better.pose.p_world_imu - truth;
    alone += (last.pose.p_world_imu - truth).squaredNorm();
    together += error.squaredNorm();
    nees += error.dot(better.pose_covariance.topLeftCorner<3, 3>().llt().solve(error));
    EXPECT_GT(least_eigenvalue(filter), 0);
  }
  EXPECT_GT(used, 0.99 * told);
  EXPECT_LT(together, 0.75 * alone);
  EXPECT_NEAR(nees / kRuns, 3.0, 1.0);
}

// Own depths that are too small make the way to the peer's camera too short, not the peer's.
TEST(DriftFilter, WhatAPeerHasFoundIsAsLongAsOwnDepthsHaveIt) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-10, 0, 0});
  const auto found = [&](double longer) {
    DriftFilter filter({}, "uav0");
    RelativePose pose = found_by_peer(as_told(relative(other, 12, own, 12, 3), "uav1"),
                                      own.keyframes[12], own.keyframes[6], kDepth_m);
    pose.T_other_own.translation() *= longer;
    EXPECT_EQ(filter.add(pose), DriftOutcome::kUsed);
    EXPECT_EQ(filter.keyframes(), 3)
        << "the own one, since when its depths were measured, the peer's";
    return filter.corrected(odometry_at(own.keyframes[12])).pose.p_world_imu.y();
  };
  // Ten metres aside that are said to be longer, by depths that were measured on the way along y.
  EXPECT_LT(found(1.003), found(1) - 1e-5);
  EXPECT_GT(found(0.997), found(1) + 1e-5);
}

// Errors of depths last: the same landmarks once more say little, those of another keyframe nearly
// all that they would say alone, and what the peer has found of the own landmarks all of it.
TEST(DriftFilter, WhatHasBeenSaidBeforeCountsLess) {
  const Walk own = walk(1, 20, {0, 0, 0});
  Walk other = walk(2, 20, {-0.3, 0, 0});
  for (KeyframePose& pose : other.keyframes) pose.covariance *= 1e-4;
  const auto just_after = [](KeyframePose pose) {
    pose.keyframe_id += 100;
    pose.stamp_ns += nanoseconds(0.1);
    return pose;
  };
  const RelativePose first = relative(own, 12, other, 12, 3);
  const auto position_variance_with = [&](const RelativePose& second) {
    DriftFilter filter({}, "uav0");
    EXPECT_EQ(filter.add(first), DriftOutcome::kUsed);
    EXPECT_EQ(filter.add(second), DriftOutcome::kUsed);
    return filter.covariance().topLeftCorner<3, 3>().trace();  // of the own keyframe, the first one
  };
  RelativePose same = relative(own, 12, other, 12, 4);
  same.own = just_after(same.own);
  RelativePose elsewhere = same;
  elsewhere.other = just_after(elsewhere.other);
  const RelativePose by_peer = found_by_peer(as_told(relative(other, 12, own, 12, 4), "uav1"),
                                             own.keyframes[12], own.keyframes[6], kDepth_m);
  EXPECT_GT(position_variance_with(same), 1.15 * position_variance_with(elsewhere));
  EXPECT_GT(position_variance_with(elsewhere), 1.08 * position_variance_with(by_peer));
}

// Remembered by the own drone, say, and then answered by the peer.
TEST(DriftFilter, TheSameKeyframeInTheSameImageIsOneMeasurement) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  DriftFilter filter({}, "uav0");
  EXPECT_EQ(filter.add(relative(own, 12, other, 12, 3)), DriftOutcome::kUsed);
  const Eigen::MatrixXd before = filter.covariance();
  EXPECT_EQ(filter.add(relative(own, 12, other, 12, 4)), DriftOutcome::kRepeated);
  EXPECT_EQ(filter.covariance(), before);
  EXPECT_EQ(filter.add(relative(own, 12, other, 11, 5)), DriftOutcome::kUsed);
}

TEST(DriftFilter, AnAnswerThatComesLateTellsWhatItWouldHaveToldInTime) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  const std::vector<std::size_t> in_time{3, 6, 9, 12, 15}, late{3, 9, 12, 15, 6};
  const auto told = [&](const std::vector<std::size_t>& order) {
    DriftFilter filter({}, "uav0");
    for (const std::size_t i : order)
      EXPECT_EQ(filter.add(relative(own, i, other, i, i)), DriftOutcome::kUsed) << i;
    return filter.corrected(odometry_at(own.keyframes[18]));
  };
  const Odometry expected = told(in_time), found = told(late);
  const Odometry without = told({3, 9, 12, 15});
  const auto distance = [&](const Odometry& odometry) {
    return (odometry.pose.p_world_imu - expected.pose.p_world_imu).norm();
  };
  EXPECT_LT(distance(found), 0.3 * distance(without));
  EXPECT_NEAR(found.pose_covariance.trace(), expected.pose_covariance.trace(),
              1e-2 * expected.pose_covariance.trace());
}

// What is found here already, and the peer's answer: more of one drone are about the same
// landmarks, and their errors hang together.
TEST(DriftFilter, OfOneDroneNoMoreThanTwoKeyframesAreComparedWithOneOfTheOwn) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  DriftFilter filter({}, "uav0");
  EXPECT_EQ(filter.add(relative(own, 12, other, 12, 3)), DriftOutcome::kUsed);
  EXPECT_EQ(filter.add(relative(own, 12, other, 11, 4)), DriftOutcome::kUsed);
  const Eigen::MatrixXd before = filter.covariance();
  for (int k = 0; k < 10; ++k)
    EXPECT_EQ(filter.add(relative(own, 12, other, k, 5 + k)), DriftOutcome::kRepeated) << k;
  EXPECT_EQ(filter.covariance(), before);
}

TEST(DriftFilter, WhatAPeerSaysToHaveFoundExactlyIsNotBelievedToBe) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  RelativePose claimed = found_by_peer(as_told(relative(other, 12, own, 12, 3), "uav1"),
                                       own.keyframes[12], own.keyframes[6], kDepth_m);
  claimed.covariance *= 1e-6;
  const auto position_variance = [&](const DriftConfig& config) {
    DriftFilter filter(config, "uav0");
    EXPECT_EQ(filter.add(claimed), DriftOutcome::kUsed);
    return filter.corrected(odometry_at(own.keyframes[12]))
        .pose_covariance.topLeftCorner<3, 3>()
        .trace();
  };
  DriftConfig credulous;
  credulous.claims.found_position_sigma_m = credulous.claims.found_angle_sigma = 0;
  EXPECT_GT(position_variance({}), position_variance(credulous) + 1e-7);
}

// Who knows how well places are found believes no claim that is more than twice as good.
TEST(DriftFilter, NobodyIsBelievedToFindPlacesMuchBetterThanTheOwnDroneDoes) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  DriftConfig config;
  config.claims.found_position_sigma_m = config.claims.found_angle_sigma = 0;
  const auto position_variance = [&](double claimed_share) {
    DriftFilter filter(config, "uav0");
    EXPECT_EQ(filter.add(relative(own, 8, other, 8, 3)), DriftOutcome::kUsed);
    RelativePose claimed = found_by_peer(as_told(relative(other, 12, own, 12, 3), "uav1"),
                                         own.keyframes[12], own.keyframes[6], kDepth_m);
    claimed.covariance = claimed_share * relative(own, 8, other, 8, 3).covariance;
    EXPECT_EQ(filter.add(claimed), DriftOutcome::kUsed);
    return filter.corrected(odometry_at(own.keyframes[12]))
        .pose_covariance.topLeftCorner<3, 3>()
        .trace();
  };
  const double believed = position_variance(config.claims.least_claim);
  EXPECT_NEAR(position_variance(1e-2), believed, 1e-3 * believed);
  EXPECT_NEAR(position_variance(1e-5), believed, 1e-3 * believed);
  EXPECT_GT(position_variance(2), 1.01 * believed);
}

TEST(DriftFilter, WhoseWayIsSaidToBeTooShortHasGoneFurther) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  const auto gone_along_way = [&](double change) {
    DriftFilter filter({}, "uav0");
    RelativePose measured = compared(own, 12, other, 12, 3);
    measured.depth_ratio->log_ratio += change;
    EXPECT_EQ(filter.add(measured), DriftOutcome::kUsed);
    return filter.corrected(odometry_at(own.keyframes.back())).pose.p_world_imu.y();
  };
  EXPECT_GT(gone_along_way(0.002), gone_along_way(0) + 1e-4);
  EXPECT_LT(gone_along_way(-0.002), gone_along_way(0) - 1e-4);
}

TEST(DriftFilter, DepthsOfTheFirstMomentsAreNotCompared) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  RelativePose early = compared(own, 12, other, 12, 3);
  early.own_before = own.keyframes[8];  // two seconds
  DriftFilter plain({}, "uav0"), comparing({}, "uav0");
  EXPECT_EQ(comparing.add(early), DriftOutcome::kUsed);
  early.depth_ratio.reset();
  EXPECT_EQ(plain.add(early), DriftOutcome::kUsed);
  EXPECT_EQ(comparing.keyframes(), plain.keyframes());
  const Odometry last = odometry_at(own.keyframes.back());
  EXPECT_EQ(comparing.corrected(last).pose.p_world_imu, plain.corrected(last).pose.p_world_imu);
}

TEST(DriftFilter, ReturningToAnOwnPlaceTakesTheDriftOut) {
  double alone = 0, together = 0;
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Walk own = walk(seed, 80, {0, 0, 0});
    DriftFilter filter({}, "uav0");
    for (const KeyframePose& pose : own.keyframes) filter.add_own(pose);
    EXPECT_EQ(filter.add(relative(own, 79, own, 2, seed, "uav0")), DriftOutcome::kUsed);
    const Odometry last = odometry_at(own.keyframes.back());
    const Eigen::Vector3d truth = own.truth.back().translation();
    alone += (last.pose.p_world_imu - truth).squaredNorm();
    together += (filter.corrected(last).pose.p_world_imu - truth).squaredNorm();
  }
  EXPECT_LT(together, 0.4 * alone);  // depths measured over a short way fix no more
}

TEST(DriftFilter, APeerThatIsFiveMetresOffIsGated) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  DriftFilter filter({}, "uav0");
  for (const KeyframePose& pose : own.keyframes) filter.add_own(pose);
  EXPECT_EQ(filter.add(five_metres_off(relative(own, 15, other, 15, 3))), DriftOutcome::kGated);
  EXPECT_EQ(filter.keyframes(), 0);
  EXPECT_FALSE(filter.alignment("uav1")) << "nothing of it has been used";
  const Odometry last = odometry_at(own.keyframes.back());
  EXPECT_NEAR((filter.corrected(last).pose.p_world_imu - last.pose.p_world_imu).norm(), 0, 1e-9);
}

// Among so few keyframes each new relative pose puts others out.
TEST(DriftFilter, WhoIsGatedPutsNoKeyframeOut) {
  const Walk own = walk(1, 60, {0, 0, 0}), other = walk(2, 60, {-3, 0, 0});
  DriftConfig config;
  config.max_keyframes = 12;
  DriftFilter filter(config, "uav0");
  for (const KeyframePose& pose : own.keyframes) filter.add_own(pose);
  for (std::size_t i = 8; i < 40; i += 4) {
    ASSERT_EQ(filter.add(relative(own, i, other, i, i)), DriftOutcome::kUsed);
  }
  const DriftFilter before = filter;
  EXPECT_EQ(filter.add(five_metres_off(relative(own, 50, other, 50, 3))), DriftOutcome::kGated);
  ASSERT_EQ(filter.keyframes(), before.keyframes());
  EXPECT_EQ(filter.covariance(), before.covariance());
  const Odometry last = odometry_at(own.keyframes.back());
  EXPECT_EQ(filter.corrected(last).pose.p_world_imu, before.corrected(last).pose.p_world_imu);
  EXPECT_EQ(filter.alignment("uav1")->p_peer, before.alignment("uav1")->p_peer);
}

// How well the own drone finds places is what peers' claims are measured by.
TEST(DriftFilter, WhatIsGatedTeachesNothingOfHowWellPlacesAreFound) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  const auto believed = [&](std::size_t gated) {
    DriftFilter filter({}, "uav0");
    EXPECT_EQ(filter.add(relative(own, 8, other, 8, 3)), DriftOutcome::kUsed);
    for (std::size_t i = 0; i < gated; ++i) {
      RelativePose exact = five_metres_off(relative(own, 14 + i, other, 14 + i, i));
      exact.covariance *= 1e-6;
      EXPECT_EQ(filter.add(exact), DriftOutcome::kGated);
    }
    RelativePose claimed = found_by_peer(as_told(relative(other, 12, own, 12, 3), "uav1"),
                                         own.keyframes[12], own.keyframes[6], kDepth_m);
    claimed.covariance *= 1e-6;
    EXPECT_EQ(filter.add(claimed), DriftOutcome::kUsed);
    return filter.covariance();
  };
  EXPECT_EQ(believed(4), believed(0));
}

TEST(DriftFilter, CovarianceStaysPositiveDefiniteOverThousandsOfUpdatesAndTheStateIsBounded) {
  DriftConfig config;
  config.max_keyframes = 30;
  DriftFilter filter(config, "uav0");
  const int keyframes = 1200;
  const Walk own = walk(1, keyframes, {0, 0, 0});
  const Walk others[] = {walk(2, keyframes, {-3, 0, 0}), walk(3, keyframes, {3, 0, 0})};
  int used = 0;
  for (std::size_t i = 8; i < static_cast<std::size_t>(keyframes); ++i) {
    filter.add_own(own.keyframes[i]);
    for (std::size_t d = 0; d < 2; ++d) {
      const auto pose = relative(own, i, others[d], i - 8 * (i % 2), i, d == 0 ? "a" : "b");
      used += filter.add(pose) == DriftOutcome::kUsed;
    }
    ASSERT_LE(filter.keyframes(), 30);
    if (i % 100 == 0) {
      ASSERT_GT(least_eigenvalue(filter), 0) << "after " << used;
    }
  }
  EXPECT_GT(used, 2000);
}

TEST(DriftFilter, NumbersThatAreNoneAreRefused) {
  const Walk own = walk(1, 7, {0, 0, 0}), other = walk(2, 7, {-3, 0, 0});
  DriftFilter filter({}, "uav0");
  RelativePose pose = relative(own, 1, other, 1, 3);
  pose.covariance(0, 0) = -1;
  EXPECT_EQ(filter.add(pose), DriftOutcome::kInvalid);
  pose = relative(own, 1, other, 1, 3);
  pose.other.covariance(2, 2) = std::nan("");
  EXPECT_EQ(filter.add(pose), DriftOutcome::kInvalid);
  pose = compared(own, 6, other, 6, 3);
  pose.depth_ratio->variance = 0;
  EXPECT_EQ(filter.add(pose), DriftOutcome::kInvalid);
  pose = compared(own, 6, other, 6, 3);
  pose.depth_ratio->log_ratio = std::nan("");
  EXPECT_EQ(filter.add(pose), DriftOutcome::kInvalid);
  pose = relative(own, 1, other, 1, 3);
  pose.own.covariance(2, 2) = std::nan("");
  EXPECT_EQ(filter.add(pose), DriftOutcome::kInvalid);
  EXPECT_EQ(filter.keyframes(), 0);
}

TEST(DriftFilter, APoseThatIsNoNumberIsRefused) {
  const Walk own = walk(1, 20, {0, 0, 0}), other = walk(2, 20, {-3, 0, 0});
  const RelativePose good = compared(own, 12, other, 12, 3);
  for (std::size_t i = 0; i < 5; ++i) {
    SCOPED_TRACE(i);
    RelativePose pose = good;
    const std::array<Eigen::Isometry3d*, 5> poses{
        &pose.own.T_world_cam, &pose.own_before.T_world_cam, &pose.other.T_world_cam,
        &pose.other_before.T_world_cam, &pose.T_other_own};
    for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()}) {
      poses[i]->translation().y() = bad;
      DriftFilter filter({}, "uav0");
      EXPECT_EQ(filter.add(pose), DriftOutcome::kInvalid);
      EXPECT_EQ(filter.keyframes(), 0);
    }
  }
}

// As `flight`, but begun later: its keyframes count from one again.
Walk begun_anew(Walk flight, double seconds) {
  for (KeyframePose& pose : flight.keyframes) pose.stamp_ns += nanoseconds(seconds);
  return flight;
}

TEST(DriftFilter, WhatAPeerSaidBeforeItStartedAnewIsForgotten) {
  const Walk own = walk(1, 60, {0, 0, 0}), first = walk(2, 30, {-3, 0, 0});
  // Another world: after its crash the peer takes its place for the origin.
  const Walk second = begun_anew(walk(3, 30, {-3, 5, 0}), 15);
  DriftFilter filter({}, "uav0"), fresh({}, "uav0");
  for (const KeyframePose& pose : own.keyframes) {
    filter.add_own(pose);
    fresh.add_own(pose);
  }
  for (std::size_t i = 10; i < 28; i += 6) {
    ASSERT_EQ(filter.add(relative(own, i, first, i, i)), DriftOutcome::kUsed);
  }
  const int keyframes = filter.keyframes();
  const RelativePose late = relative(own, 29, first, 29, 4);
  ASSERT_EQ(filter.add(relative(own, 45, second, 12, 5)), DriftOutcome::kUsed);
  ASSERT_EQ(fresh.add(relative(own, 45, second, 12, 5)), DriftOutcome::kUsed);
  EXPECT_LT(filter.keyframes(), keyframes) << "only the own ones and the new ones are left";
  EXPECT_NEAR(filter.alignment("uav1")->position_sigma, fresh.alignment("uav1")->position_sigma,
              0.2 * fresh.alignment("uav1")->position_sigma);
  EXPECT_GT(least_eigenvalue(filter), 0);
  EXPECT_EQ(filter.add(late), DriftOutcome::kInvalid) << "of the earlier flight";
  EXPECT_EQ(filter.add(relative(own, 50, second, 17, 6)), DriftOutcome::kUsed);
}

TEST(DriftFilter, APeerThatStartsAnewElsewhereIsAlignedAnew) {
  DriftConfig config;
  config.common_start = false;
  const Walk own = walk(1, 100, {0, 0, 0}), first = walk(2, 40, {-3, 0, 0});
  const Walk second = begun_anew(walk(3, 40, {-3, 20, 0}), 10);
  DriftFilter filter(config, "uav0");
  for (const KeyframePose& pose : own.keyframes) filter.add_own(pose);
  for (std::size_t i = 4; i < 40; ++i) (void)filter.add(relative(own, i, first, i, i));
  ASSERT_TRUE(filter.alignment("uav1"));
  EXPECT_EQ(filter.add(relative(own, 39, second, 21, 7)), DriftOutcome::kUnaligned);
  EXPECT_FALSE(filter.alignment("uav1")) << "nobody knows yet where its new world lies";
}

TEST(DriftFilter, ADroneThatIsForgottenLeavesNothingButItsName) {
  const Walk own = walk(1, 30, {0, 0, 0}), other = walk(2, 30, {-3, 0, 0});
  DriftFilter filter({}, "uav0");
  for (const KeyframePose& pose : own.keyframes) filter.add_own(pose);
  for (std::size_t i = 5; i < 25; i += 5) {
    ASSERT_EQ(filter.add(relative(own, i, other, i, i, "uav1")), DriftOutcome::kUsed);
    ASSERT_EQ(filter.add(relative(own, i, other, i, i + 50, "uav2")), DriftOutcome::kUsed);
  }
  const WorldAlignment kept = *filter.alignment("uav2");
  const int keyframes = filter.keyframes();
  filter.forget_drone("uav1");
  filter.forget_drone("never heard");
  EXPECT_LT(filter.keyframes(), keyframes);
  EXPECT_FALSE(filter.alignment("uav1"));
  EXPECT_TRUE(filter.alignment("uav2")->T_own_peer.isApprox(kept.T_own_peer));
  EXPECT_EQ(filter.peers().size(), 2u);
  EXPECT_GT(least_eigenvalue(filter), 0);
  EXPECT_EQ(filter.add(relative(own, 25, other, 25, 99, "uav1")), DriftOutcome::kUsed);
}

TEST(DriftFilter, InventedDronesAreBounded) {
  const Walk own = walk(1, 3, {0, 0, 0}), other = walk(2, 3, {-3, 0, 0});
  DriftFilter filter({}, "uav0");
  for (int i = 0; i < 200; ++i) {
    (void)filter.add(relative(own, 1, other, 1, 3, "ghost" + std::to_string(i)));
  }
  EXPECT_LT(filter.peers().size(), 64u);
}

}  // namespace
}  // namespace covey
