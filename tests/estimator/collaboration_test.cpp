// SPDX-License-Identifier: Apache-2.0
//
// Teams whose filters fuse each other's landmarks by covariance intersection: is a drone better off
// with a better peer, and does it stay as good as it says?
#include <gtest/gtest.h>

#include <array>
#include <optional>
#include <utility>

#include "tests/estimator/team_flight.h"

namespace covey {
namespace {

constexpr int kSeeds = kEnoughForStatistics ? 12 : 1;
constexpr double kSettled_s = 3;

// Means over the seeds, after the start.
struct DroneStatistics {
  double position_m = 0;                           // root mean square
  double position_nees = 0, orientation_nees = 0;  // over their degrees of freedom
};

struct TeamStatistics {
  std::vector<DroneStatistics> drones;
  PeerReport fused;
  int messages_used = 0;
};

DroneStatistics statistics_of(const FilterRun& run) {
  DroneStatistics mean;
  int count = 0;
  for (const ErrorSample& error : run.errors) {
    if (error.time_s < kSettled_s) continue;
    mean.position_m += error.position_m * error.position_m;
    mean.position_nees += error.position_nees / 3;
    mean.orientation_nees += error.orientation_nees / 3;
    ++count;
  }
  mean.position_m = std::sqrt(mean.position_m / count);
  mean.position_nees /= count;
  mean.orientation_nees /= count;
  return mean;
}

TeamStatistics fly_all(const TeamFlight& flight) {
  TeamStatistics sum;
  sum.drones.resize(flight.pixel_sigma.size());
  for (int seed = 1; seed <= kSeeds; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    const TeamRun run = fly(flight, static_cast<std::uint64_t>(seed));
    sum.fused.used += run.fused.used;
    sum.fused.gated += run.fused.gated;
    sum.fused.unknown_track += run.fused.unknown_track;
    sum.messages_used += run.messages_used;
    for (std::size_t i = 0; i < run.drones.size(); ++i) {
      EXPECT_TRUE(run.drones[i].covariance_valid);
      EXPECT_EQ(run.drones[i].reinitialized, 0);
      const DroneStatistics drone = statistics_of(run.drones[i]);
      sum.drones[i].position_m += drone.position_m / kSeeds;
      sum.drones[i].position_nees += drone.position_nees / kSeeds;
      sum.drones[i].orientation_nees += drone.orientation_nees / kSeeds;
    }
  }
  return sum;
}

void expect_honest(const TeamStatistics& team) {
  for (std::size_t i = 0; i < team.drones.size(); ++i) {
    SCOPED_TRACE("drone " + std::to_string(i));
    EXPECT_GT(team.drones[i].position_nees, 0.4);
    EXPECT_LT(team.drones[i].position_nees, 1.6);
    EXPECT_LT(team.drones[i].orientation_nees, 1.6);
  }
}

constexpr double kPoor_px = 1.4, kGood_px = 0.4;

TeamStatistics alone(TeamFlight flight) {
  flight.collaborate = false;
  return fly_all(flight);
}

// The first drone uses what it hears, stays honest and becomes better. Returns the team and each
// alone; nothing where there are too few flights to say.
std::optional<std::pair<TeamStatistics, TeamStatistics>> expect_gain(const TeamFlight& flight) {
  TeamStatistics team = fly_all(flight);
  EXPECT_GT(team.messages_used, kSeeds);
  if (!kEnoughForStatistics) return std::nullopt;
  expect_honest(team);
  TeamStatistics solo = alone(flight);
  EXPECT_LT(team.drones[0].position_m, 0.85 * solo.drones[0].position_m);
  return std::pair(std::move(team), std::move(solo));
}

TEST(Collaboration, ADroneGainsFromAPeerThatSeesBetterAndStaysHonest) {
  TeamFlight flight;
  flight.pixel_sigma = {kPoor_px, kGood_px};
  const auto flown = expect_gain(flight);
  if (!flown) return;
  const auto& [team, solo] = *flown;
  EXPECT_LT(team.drones[1].position_m, 1.02 * solo.drones[1].position_m);
}

TEST(Collaboration, ADroneWithoutSlamFeaturesGainsByItsMsckfTracks) {
  TeamFlight flight;
  flight.pixel_sigma = {kPoor_px, kGood_px};
  flight.config.max_slam_features = 0;
  (void)expect_gain(flight);
}

// Two peers see the same landmarks as the own drone, and tell each other as well.
TEST(Collaboration, TwoPeersOfOneLandmarkLeaveTheDroneHonest) {
  TeamFlight flight;
  flight.pixel_sigma = {kPoor_px, kGood_px, kGood_px};
  (void)expect_gain(flight);
}

TEST(Collaboration, WrongMatchesDoNoHarm) {
  TeamFlight flight;
  flight.pixel_sigma = {kPoor_px, kGood_px};
  flight.wrong_share = 0.1;
  const TeamStatistics team = fly_all(flight);
  EXPECT_GT(team.fused.gated, 0);
  if (!kEnoughForStatistics) return;
  expect_honest(team);
}

// What has been seen meanwhile is in the filter; tracks that have ended are not found there any
// more.
TEST(Collaboration, AnswersThatComeLateAreUsedAsFarAsTheirTracksLastAndDoNoHarm) {
  TeamFlight flight;
  flight.pixel_sigma = {kPoor_px, kGood_px};
  const TeamStatistics at_once = fly_all(flight);
  flight.answer_delay_s = 1;
  const TeamStatistics late = fly_all(flight);
  EXPECT_GT(late.fused.used, 0);
  EXPECT_LT(late.fused.used, at_once.fused.used);
  EXPECT_GT(late.fused.unknown_track, at_once.fused.unknown_track);
  if (!kEnoughForStatistics) return;
  expect_honest(late);
  EXPECT_LT(late.drones[0].position_m, 1.02 * alone(flight).drones[0].position_m);
}

}  // namespace
}  // namespace covey
