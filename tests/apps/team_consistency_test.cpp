// SPDX-License-Identifier: Apache-2.0
//
// Is a team as good as it says, and what can one bad peer do to it? Simulated features, every
// drone's real filter and drift filter; starts disturbed by the covariance that the filter is told.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <string>
#include <thread>
#include <vector>

#include "apps/feature_team.h"
#include "estimator/relative_pose.h"
#include "tests/estimator/enough_for_statistics.h"

namespace covey {
namespace {

constexpr int kSeeds = kEnoughForStatistics ? 50 : 1;  // of each scene
constexpr int kFewSeeds = kEnoughForStatistics ? 40 : 1;
constexpr int kThreads = 2;
constexpr std::size_t kDrones = 4, kBadPeer = 3;
constexpr char kBadName[] = "uav3";
constexpr std::size_t kBins = 8;  // of time
constexpr double kLeast = 0.5, kMost = 1.3, kDegreesOfFreedom = 3;
constexpr std::array<Scenario, 4> kScenarios{Scenario::kRoom, Scenario::kCastleAround,
                                             Scenario::kMarsYard, Scenario::kCastleParallel};

struct SimulatedTeam {
  SoloTeam solo;
  FeatureExchangeConfig exchange;
};

SimulatedTeam simulate_team(Scenario place, std::uint64_t seed) {
  constexpr double kCornerMismatch_px = 0.15;  // as between two rendered drones
  FeatureScenario scenario;
  scenario.flight.scenario = place;
  scenario.flight.agents = static_cast<int>(kDrones);
  scenario.flight.duration_s = 9;
  scenario.camera.first_image_s = 0.1023;  // never on an IMU sample
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  SimulatedTeam team;
  team.exchange.bearing_sigma = scenario.camera.pixel_sigma / scenario.camera.focal_px;
  team.exchange.corner_mismatch = kCornerMismatch_px / scenario.camera.focal_px;
  team.exchange.seed = seed;
  team.solo = fly_team_alone(simulate_features(scenario, seed), config,
                             team.exchange.limits.keyframe, seed);
  return team;
}

std::vector<TeamMember> together(const SimulatedTeam& team, const FeatureExchange& exchange) {
  return fuse_jointly(team.solo, exchange, DriftConfig{},
                      team.exchange.limits.matching.min_matches);
}

template <typename Work>
void for_seeds(int seeds, const Work& work) {
  std::atomic<int> next{1};
  const auto take = [&] {
    for (int seed = next++; seed <= seeds; seed = next++) work(seed);
  };
  std::vector<std::thread> threads;
  for (int i = 0; i < kThreads; ++i) threads.emplace_back(take);
  for (std::thread& thread : threads) thread.join();
}

struct TimeBin {
  double position = 0, orientation = 0;  // sums of NEES over degrees of freedom
  int count = 0;

  TimeBin& operator+=(const TimeBin& other) {
    position += other.position;
    orientation += other.orientation;
    count += other.count;
    return *this;
  }
};
using TimeBins = std::array<TimeBin, kBins>;

void add(TimeBins& bins, const FlownPath& path) {
  const std::size_t images = path.truth.size();
  for (std::size_t k = 0; k < images; ++k) {
    const NeesSample nees = nees_of(path.odometry[k], path.truth[k]);
    TimeBin& bin = bins[k * kBins / images];
    bin.position += nees.position / kDegreesOfFreedom;
    bin.orientation += nees.orientation / kDegreesOfFreedom;
    ++bin.count;
  }
}

void expect_consistent(const TimeBin& bin, const std::string& name) {
  const double position = bin.position / bin.count, orientation = bin.orientation / bin.count;
  ::testing::Test::RecordProperty("position_nees_of_" + name, std::to_string(position));
  ::testing::Test::RecordProperty("orientation_nees_of_" + name, std::to_string(orientation));
  EXPECT_GT(position, kLeast) << name;
  EXPECT_LT(position, kMost) << name;
  EXPECT_GT(orientation, kLeast) << name;
  EXPECT_LT(orientation, kMost) << name;
}

TimeBin sum_of(const TimeBins& bins) {
  TimeBin sum;
  for (const TimeBin& bin : bins) sum += bin;
  return sum;
}

// Of every scene the whole, of all scenes together every eighth of the flight.
void expect_consistent(const std::array<TimeBins, kScenarios.size()>& scenes) {
  for (std::size_t s = 0; s < scenes.size(); ++s)
    expect_consistent(sum_of(scenes[s]), std::string(scenario_name(kScenarios[s])));
  for (std::size_t i = 0; i < kBins; ++i) {
    TimeBin eighth;
    for (const TimeBins& bins : scenes) eighth += bins[i];
    expect_consistent(eighth, "eighth_" + std::to_string(i + 1));
  }
}

TEST(TeamConsistency, ErrorsOfFourDronesTogetherAreAsLargeAsTheCovarianceSays) {
  constexpr int kFlights = kSeeds * static_cast<int>(kScenarios.size());
  const auto scene_of = [](int flight) {
    return static_cast<std::size_t>(flight) % kScenarios.size();
  };
  std::vector<std::vector<TeamMember>> flown(kFlights);
  for_seeds(kFlights, [&](int seed) {
    const auto team = simulate_team(kScenarios[scene_of(seed)], static_cast<std::uint64_t>(seed));
    flown[static_cast<std::size_t>(seed) - 1] =
        together(team, FeatureExchange(team.exchange, team.solo.names));
  });
  std::array<TimeBins, kScenarios.size()> scenes;
  int used = 0;
  for (int seed = 1; seed <= kFlights; ++seed) {
    for (const TeamMember& member : flown[static_cast<std::size_t>(seed) - 1]) {
      add(scenes[scene_of(seed)], member.path);
      used += member.used;
    }
  }
  EXPECT_GT(used, kFlights * 20);  // or it was no team
  if (kEnoughForStatistics) expect_consistent(scenes);
}

// What the drones but the last one came to, over all seeds.
struct Others {
  double aligned_m = 0, unaligned_m = 0;           // means of the drones' RMSE
  double position_nees = 0, orientation_nees = 0;  // means, over degrees of freedom
  int believed_bad = 0;                            // drones that used what the last one says
  int gated = 0;                                   // relative poses
};

void add(Others& others, const std::vector<TeamMember>& members) {
  const double share = 1.0 / (static_cast<double>(kBadPeer) * kFewSeeds);
  for (std::size_t i = 0; i < kBadPeer; ++i) {
    const PathFigures figures = figures_of(members[i].path);
    others.aligned_m += share * figures.aligned_m;
    others.unaligned_m += share * figures.unaligned_m;
    others.position_nees += share * figures.position_nees / kDegreesOfFreedom;
    others.orientation_nees += share * figures.orientation_nees / kDegreesOfFreedom;
    others.believed_bad += static_cast<int>(members[i].peers.count(kBadName));
    others.gated += members[i].gated;
  }
}

void expect_not_hurt(const Others& with_bad_peer, const Others& without) {
  constexpr double kMostLoss = 1.05;
  EXPECT_LT(with_bad_peer.aligned_m, kMostLoss * without.aligned_m);
  EXPECT_LT(with_bad_peer.unaligned_m, kMostLoss * without.unaligned_m);
  EXPECT_LT(with_bad_peer.position_nees, kMost);
  EXPECT_LT(with_bad_peer.orientation_nees, kMost);
}

// Wrong: by 5 m. Lies: claims a hundredth of its sigmas. Echoes: every answer comes a hundred
// times.
TEST(TeamConsistency, OnePeerThatIsWrongOrLiesCostsTheOthersAtMostFivePercent) {
  enum Case : std::size_t { kSilent, kWrong, kLies, kWrongAndLies, kEchoes, kCases };
  std::vector<std::array<std::vector<TeamMember>, kCases>> flown(kFewSeeds);
  for_seeds(kFewSeeds, [&](int seed) {
    const auto team = simulate_team(Scenario::kCastleParallel, static_cast<std::uint64_t>(seed));
    auto& result = flown[static_cast<std::size_t>(seed) - 1];
    FeatureExchange silent(team.exchange, team.solo.names);
    silent.silence(kBadPeer);
    result[kSilent] = together(team, silent);
    const auto with = [&](const Falsehood& falsehood) {
      FeatureExchange exchange(team.exchange, team.solo.names);
      exchange.falsify(kBadPeer, falsehood);
      return together(team, exchange);
    };
    result[kWrong] = with({{5, 0, 0}, 1});
    result[kLies] = with({{0, 0, 0}, 0.01});
    result[kWrongAndLies] = with({{0, 5, 0}, 0.01});
    FeatureExchangeConfig echoing = team.exchange;
    echoing.copies = 100;
    result[kEchoes] = together(team, FeatureExchange(echoing, team.solo.names));
  });
  std::array<Others, kCases> others;
  for (const auto& result : flown) {
    for (std::size_t i = 0; i < kCases; ++i) add(others[i], result[i]);
  }
  EXPECT_EQ(others[kSilent].believed_bad, 0);
  for (const Case heard : {kLies, kEchoes}) EXPECT_GT(others[heard].believed_bad, 0) << heard;
  for (const Case off : {kWrong, kWrongAndLies}) EXPECT_GT(others[off].gated, 0) << off;
  if (!kEnoughForStatistics) return;
  for (const Case off : {kWrong, kWrongAndLies})
    EXPECT_GT(others[off].gated, 5 * kFewSeeds + others[kSilent].gated) << off;
  for (const Case bad : {kWrong, kLies, kWrongAndLies, kEchoes}) {
    SCOPED_TRACE("case " + std::to_string(bad));
    expect_not_hurt(others[bad], others[kSilent]);
  }
}

// Variance of the first drone's position (m2) once it has heard the same answer so many times.
double variance_after(const SimulatedTeam& team, const RelativePose& answer, int times) {
  DriftFilter filter(DriftConfig{}, team.solo.names[0]);
  for (const FlownImage& image : team.solo.flights[0]) {
    if (image.keyframe) filter.add_own(image.keyframe->pose);
  }
  for (int i = 0; i < times; ++i) (void)filter.add(answer);
  const Odometry odometry = filter.corrected(team.solo.flights[0].back().alone);
  return odometry.pose_covariance.topLeftCorner<3, 3>().trace();
}

TEST(TeamConsistency, TheSameAnswerAHundredTimesSaysNoMoreThanTwice) {
  const SimulatedTeam team = simulate_team(Scenario::kCastleParallel, 3);
  FeatureExchange exchange(team.exchange, team.solo.names);
  for (std::size_t i = 0; i < kDrones; ++i) {
    for (const FlownImage& image : team.solo.flights[i]) {
      if (image.keyframe) exchange.add_keyframe(i, *image.keyframe);
    }
  }
  const std::vector<KeyframeMatch> answers = exchange.ask(0);
  ASSERT_FALSE(answers.empty());
  const auto answer =
      estimate_relative_pose(answers.front(), team.exchange.limits.matching.min_matches);
  ASSERT_TRUE(answer);
  const double often = variance_after(team, *answer, 100);
  EXPECT_LT(often, variance_after(team, *answer, 0));
  EXPECT_GE(often, (1 - 1e-9) * variance_after(team, *answer, 2));
}

// What the central filter gains is only a ceiling if it is honest itself.
TEST(TeamConsistency, TheCentralFilterIsConsistentAndBetterThanItsDronesByThemselves) {
  constexpr double kOwnStart_s = 2;
  FeatureScenario scenario;
  scenario.flight.scenario = Scenario::kCastleParallel;
  scenario.flight.agents = 2;
  scenario.flight.duration_s = 5;
  scenario.camera.first_image_s = 0.1023;
  EstimatorConfig config;
  config.imu_noise = scenario.imu.noise;
  const KeyframeRule rule = CollaboratorConfig{}.keyframe;
  constexpr int kFlights = kEnoughForStatistics ? 6 : 1;
  std::vector<Others> apart(kFlights), joined(kFlights);
  const auto add = [](Others& sum, const std::vector<TeamMember>& members) {
    for (const TeamMember& member : members) {
      const PathFigures figures = figures_of(member.path);
      sum.aligned_m += figures.aligned_m;
      sum.position_nees += figures.position_nees / kDegreesOfFreedom;
      sum.orientation_nees += figures.orientation_nees / kDegreesOfFreedom;
    }
  };
  for_seeds(kFlights, [&](int seed) {
    const auto s = static_cast<std::uint64_t>(seed);
    const FeatureSimulation simulation = simulate_features(scenario, s);
    const auto at = static_cast<std::size_t>(seed) - 1;
    add(apart[at], fuse_centrally(simulation, config, rule, s, {{0}, {1}}, kOwnStart_s));
    add(joined[at], fuse_centrally(simulation, config, rule, s, {{0, 1}}, kOwnStart_s));
  });
  double error_apart = 0, error_joined = 0, position_nees = 0, orientation_nees = 0;
  for (std::size_t i = 0; i < apart.size(); ++i) {
    error_apart += apart[i].aligned_m;
    error_joined += joined[i].aligned_m;
    position_nees += joined[i].position_nees / (2 * kFlights);
    orientation_nees += joined[i].orientation_nees / (2 * kFlights);
  }
  if (!kEnoughForStatistics) return;
  EXPECT_LT(error_joined, 0.95 * error_apart);
  EXPECT_GT(position_nees, 0.3);
  EXPECT_LT(position_nees, 1.6);
  EXPECT_GT(orientation_nees, 0.3);
  EXPECT_LT(orientation_nees, 1.6);
}

}  // namespace
}  // namespace covey
