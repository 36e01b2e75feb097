// SPDX-License-Identifier: Apache-2.0
#include "apps/team_study.h"

#include <algorithm>
#include <functional>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <utility>

#include "apps/feature_team.h"

namespace covey {
namespace {

// How many flights of all drones are done.
class FlightCount {
 public:
  FlightCount(const OnFlight& tell, std::size_t flights) : tell_(tell), flights_(flights) {}

  void tell() const {
    if (tell_) tell_(done_, flights_);
  }
  void add() {
    ++done_;
    tell();
  }

 private:
  const OnFlight& tell_;
  std::size_t done_ = 0, flights_;
};

struct SimulatedTeam {
  FeatureSimulation simulation;
  EstimatorConfig estimator;
  FeatureExchangeConfig exchange;
  SoloTeam solo;
  std::vector<PathFigures> alone;  // of each drone
  AfterImage after_image;
};

// Names and ids are free text: these do not fit into a signed byte.
std::string name_of(std::size_t drone) { return "hawk-" + std::to_string(200 + drone); }

// Everybody flies as long.
double duration_s(const StudyConfig& config) {
  double duration_s = config.duration_s;
  for (const Trajectory& flight : config.recorded) {
    const double recorded_s = flight.duration_s();
    duration_s = duration_s > 0 ? std::min(duration_s, recorded_s) : recorded_s;
  }
  return duration_s;
}

// `count`: must outlive it.
SimulatedTeam simulate_team(const StudyConfig& config, int drones, std::uint64_t seed,
                            const FlightCount& count) {
  const std::optional<Scenario> place = scenario_from_name(config.scenario);
  if (!place) {
    throw std::runtime_error("study: no scenario '" + config.scenario +
                             "'; take castle_around, castle_parallel, mars_yard or room");
  }
  FeatureScenario scenario;
  scenario.flight.scenario = *place;
  scenario.flight.agents = drones;
  scenario.flight.duration_s = duration_s(config);
  scenario.flight.recorded = config.recorded;
  scenario.camera.pixel_sigma = config.pixel_sigma;
  scenario.camera.first_image_s = 0.1023;  // never on an IMU sample
  SimulatedTeam team{simulate_features(scenario, seed), {}, {}, {}, {}, [&count] { count.tell(); }};
  for (std::size_t i = 0; i < team.simulation.drones.size(); ++i) {
    team.simulation.drones[i].name = name_of(i);
  }
  team.estimator.imu_noise = scenario.imu.noise;
  team.exchange.bearing_sigma = scenario.camera.pixel_sigma / scenario.camera.focal_px;
  team.exchange.corner_mismatch = config.corner_mismatch_px / scenario.camera.focal_px;
  team.exchange.seed = seed;
  team.solo = fly_team_alone(team.simulation, team.estimator, team.exchange.limits.keyframe, seed,
                             team.after_image);
  for (const TeamMember& member : alone(team.solo)) team.alone.push_back(figures_of(member.path));
  return team;
}

std::vector<TeamMember> fuse(const SimulatedTeam& team, const FeatureExchangeConfig& exchange) {
  return fuse_jointly(team.solo, FeatureExchange(exchange, team.solo.names), DriftConfig{},
                      exchange.limits.matching.min_matches, team.after_image);
}

void add(TeamFigures& sum, const std::vector<TeamMember>& members, const SimulatedTeam& team,
         int seeds) {
  constexpr double kDegreesOfFreedom = 3;
  constexpr double kWorse = 1.03;
  const double share = 1 / (static_cast<double>(members.size()) * seeds);
  for (std::size_t i = 0; i < members.size(); ++i) {
    const PathFigures figures = figures_of(members[i].path);
    sum.aligned_m += share * figures.aligned_m;
    sum.unaligned_m += share * figures.unaligned_m;
    sum.position_nees += share * figures.position_nees / kDegreesOfFreedom;
    sum.orientation_nees += share * figures.orientation_nees / kDegreesOfFreedom;
    sum.worse_aligned += figures.aligned_m > kWorse * team.alone[i].aligned_m ? share : 0;
    sum.worse_unaligned += figures.unaligned_m > kWorse * team.alone[i].unaligned_m ? share : 0;
  }
}

double flown_s(const TeamMember& member) {
  return seconds_between(member.path.odometry.front().stamp_ns,
                         member.path.odometry.back().stamp_ns);
}

using Variant =
    std::pair<std::string, std::function<std::vector<TeamMember>(const SimulatedTeam&)>>;

std::vector<TeamMember> fuse_parts(const SimulatedTeam& team, SharedLandmarks landmarks,
                                   bool own_loops) {
  FeatureExchangeConfig exchange = team.exchange;
  exchange.landmarks = landmarks;
  exchange.own_loops = own_loops;
  return fuse(team, exchange);
}

std::vector<TeamMember> fuse_own_loops(const SimulatedTeam& team) {
  FeatureExchange exchange(team.exchange, team.solo.names);
  for (std::size_t i = 0; i < team.solo.names.size(); ++i) exchange.silence(i);
  return fuse_jointly(team.solo, exchange, DriftConfig{}, team.exchange.limits.matching.min_matches,
                      team.after_image);
}

std::vector<TeamMember> fuse_untold(const SimulatedTeam& team) {
  FeatureExchangeConfig exchange = team.exchange;
  exchange.limits.tell_found = false;
  return fuse(team, exchange);
}

// No corner is off, and everybody answers every keyframe with all that it has.
std::vector<TeamMember> fuse_unlimited(const SimulatedTeam& team) {
  FeatureExchangeConfig exchange = team.exchange;
  exchange.limits.limiter.answer_interval_s = 0;
  exchange.limits.limiter.resend_interval_s = 0;
  exchange.limits.limiter.landmarks_per_s = 0;
  exchange.limits.max_revisits = static_cast<int>(team.solo.names.size());
  exchange.corner_mismatch = 0;
  return fuse(team, exchange);
}

std::vector<std::size_t> all_of(const SimulatedTeam& team) {
  std::vector<std::size_t> drones(team.solo.names.size());
  std::iota(drones.begin(), drones.end(), 0);
  return drones;
}

std::vector<std::vector<std::size_t>> each_by_itself(const SimulatedTeam& team) {
  std::vector<std::vector<std::size_t>> groups;
  for (const std::size_t drone : all_of(team)) groups.push_back({drone});
  return groups;
}

std::vector<TeamMember> fuse_centrally(const SimulatedTeam& team,
                                       const std::vector<std::vector<std::size_t>>& groups) {
  constexpr double kOwnStart_s = 2;
  return fuse_centrally(team.simulation, team.estimator, team.exchange.limits.keyframe,
                        team.exchange.seed, groups, kOwnStart_s, team.after_image);
}

std::vector<Variant> variants() {
  return {
      {"alone", [](const SimulatedTeam& team) { return alone(team.solo); }},
      {"own loop closures alone", fuse_own_loops},
      {"SLAM features alone",
       [](const SimulatedTeam& team) { return fuse_parts(team, SharedLandmarks::kSlam, false); }},
      {"window tracks alone (MSCKF)",
       [](const SimulatedTeam& team) { return fuse_parts(team, SharedLandmarks::kWindow, false); }},
      {"both",
       [](const SimulatedTeam& team) { return fuse_parts(team, SharedLandmarks::kAll, false); }},
      {"both and own loop closures: joint, the default",
       [](const SimulatedTeam& team) { return fuse_parts(team, SharedLandmarks::kAll, true); }},
      {"covariance intersection in the filter",
       [](const SimulatedTeam& team) {
         return fuse_by_intersection(
             team.simulation, team.estimator, team.exchange.limits.keyframe, team.exchange.seed,
             FeatureExchange(team.exchange, team.solo.names), team.after_image);
       }},
      {"split covariance intersection of corrected poses",
       [](const SimulatedTeam& team) {
         return fuse_by_split_intersection(
             team.solo, FeatureExchange(team.exchange, team.solo.names),
             team.exchange.limits.matching.min_matches, team.after_image);
       }},
      {"joint, and nobody hears what came of its answer", fuse_untold},
      {"joint, unlimited answers, corners coincide", fuse_unlimited},
      {"the central filter, each drone by itself",
       [](const SimulatedTeam& team) { return fuse_centrally(team, each_by_itself(team)); }},
      {"oracle: the central filter, all drones",
       [](const SimulatedTeam& team) { return fuse_centrally(team, {all_of(team)}); }},
  };
}

}  // namespace

ScalingPoint study_team_size(const StudyConfig& config, int drones, const OnFlight& on_flight) {
  FlightCount count(on_flight, 2 * static_cast<std::size_t>(config.seeds));
  count.tell();
  ScalingPoint point;
  point.drones = drones;
  for (int seed = 1; seed <= config.seeds; ++seed) {
    const SimulatedTeam team =
        simulate_team(config, drones, static_cast<std::uint64_t>(seed), count);
    count.add();
    add(point.alone, alone(team.solo), team, config.seeds);
    const std::vector<TeamMember> together = fuse(team, team.exchange);
    count.add();
    add(point.together, together, team, config.seeds);
    const double share = 1 / (static_cast<double>(drones) * config.seeds);
    for (const TeamMember& member : together) {
      const double per_s = share / flown_s(member);
      const auto questions = static_cast<double>(member.traffic.advert_bytes);
      const auto answers = static_cast<double>(member.traffic.answer_bytes);
      point.overlapping_peers += share * static_cast<double>(member.peers.size());
      point.question_bytes_per_s += per_s * questions;
      point.answer_bytes_per_s += per_s * answers;
      point.sent_bytes_per_s += per_s * (answers + questions * (drones - 1));
      point.fusion_ms_per_s += per_s * member.fusion_cpu_ms;
    }
  }
  return point;
}

std::vector<AblationRow> study_parts(const StudyConfig& config, int drones,
                                     const OnFlight& on_flight) {
  const std::vector<Variant> all = variants();
  FlightCount count(on_flight, (1 + all.size()) * static_cast<std::size_t>(config.seeds));
  count.tell();
  std::vector<AblationRow> rows(all.size());
  for (int seed = 1; seed <= config.seeds; ++seed) {
    const SimulatedTeam team =
        simulate_team(config, drones, static_cast<std::uint64_t>(seed), count);
    count.add();
    for (std::size_t i = 0; i < all.size(); ++i) {
      const std::vector<TeamMember> members = all[i].second(team);
      count.add();
      rows[i].variant = all[i].first;
      add(rows[i].figures, members, team, config.seeds);
      for (const TeamMember& member : members) {
        rows[i].relative_poses +=
            member.used / (static_cast<double>(members.size()) * config.seeds);
      }
    }
  }
  return rows;
}

}  // namespace covey
