// SPDX-License-Identifier: Apache-2.0
#include "apps/feature_team.h"

#include <utility>

#include "apps/process_usage.h"
#include "estimator/relative_pose.h"

namespace covey {
namespace {

void record(TeamMember& member, const Odometry& odometry, const Pose& truth) {
  member.path.odometry.push_back(odometry);
  member.path.truth.push_back(truth);
}

void fuse(DriftFilter& drift, const std::string& own_name, const KeyframeMatch& match,
          int min_matches, TeamMember& member) {
  const auto relative = estimate_relative_pose(match, min_matches);
  if (!relative) return;
  const DriftOutcome outcome = drift.add(*relative);
  member.used += outcome == DriftOutcome::kUsed ? 1 : 0;
  member.gated += outcome == DriftOutcome::kGated ? 1 : 0;
  const bool of_peer = match.drone != own_name;
  if (outcome == DriftOutcome::kUsed && of_peer) member.peers.insert(match.drone);
}

}  // namespace

SoloTeam fly_team_alone(const FeatureSimulation& simulation, const EstimatorConfig& config,
                        const KeyframeRule& rule, std::uint64_t seed) {
  SoloTeam team;
  for (std::size_t i = 0; i < simulation.drones.size(); ++i) {
    const DroneFeatures& drone = simulation.drones[i];
    team.names.push_back(drone.name);
    team.flights.push_back(fly_alone(drone, config, rule, seed * 100 + i));
  }
  return team;
}

std::vector<TeamMember> alone(const SoloTeam& team) {
  std::vector<TeamMember> members(team.names.size());
  for (std::size_t i = 0; i < members.size(); ++i) {
    for (const FlownImage& image : team.flights[i]) record(members[i], image.alone, image.truth);
  }
  return members;
}

std::vector<TeamMember> fuse_jointly(const SoloTeam& team, FeatureExchange exchange,
                                     const DriftConfig& drift, int min_matches) {
  std::vector<TeamMember> members(team.names.size());
  std::vector<DriftFilter> filters;
  for (const std::string& name : team.names) filters.emplace_back(drift, name);
  const auto fuse_all = [&](std::size_t i, const std::vector<KeyframeMatch>& matches) {
    const double start_ms = thread_cpu_ms();
    for (const KeyframeMatch& match : matches)
      fuse(filters[i], team.names[i], match, min_matches, members[i]);
    members[i].fusion_cpu_ms += thread_cpu_ms() - start_ms;
  };
  for (std::size_t k = 0; k < team.flights.front().size(); ++k) {
    for (std::size_t i = 0; i < members.size(); ++i) {
      const FlownImage& image = team.flights[i][k];
      if (image.keyframe) {
        filters[i].add_own(image.keyframe->pose);
        exchange.add_keyframe(i, *image.keyframe);
        fuse_all(i, exchange.revisit(i));
      }
      const double start_ms = thread_cpu_ms();
      const Odometry corrected = filters[i].corrected(image.alone);
      members[i].fusion_cpu_ms += thread_cpu_ms() - start_ms;
      record(members[i], corrected, image.truth);
    }
    // Answers come after the image.
    for (std::size_t i = 0; i < members.size(); ++i) {
      if (team.flights[i][k].keyframe) fuse_all(i, exchange.ask(i));
    }
  }
  for (std::size_t i = 0; i < members.size(); ++i) members[i].traffic = exchange.traffic(i);
  return members;
}

std::vector<TeamMember> fuse_by_intersection(const FeatureSimulation& simulation,
                                             const EstimatorConfig& config,
                                             const KeyframeRule& rule, std::uint64_t seed,
                                             FeatureExchange exchange) {
  std::vector<TeamMember> members(simulation.drones.size());
  std::vector<FeatureFlight> flights;
  for (std::size_t i = 0; i < members.size(); ++i) {
    flights.emplace_back(simulation.drones[i], config, rule, seed * 100 + i);
  }
  while (!flights.front().ended()) {
    std::vector<bool> asks(members.size());
    for (std::size_t i = 0; i < members.size(); ++i) {
      const FlownImage image = flights[i].next();
      record(members[i], image.alone, image.truth);
      asks[i] = image.keyframe.has_value();
      if (image.keyframe) exchange.add_keyframe(i, *image.keyframe);
    }
    for (std::size_t i = 0; i < members.size(); ++i) {
      if (!asks[i]) continue;
      const double start_ms = thread_cpu_ms();
      for (const KeyframeMatch& match : exchange.ask(i)) {
        const PeerReport report = flights[i].fuse(match);
        members[i].used += report.used > 0 ? 1 : 0;
        members[i].gated += report.used == 0 && report.gated > 0 ? 1 : 0;
      }
      members[i].fusion_cpu_ms += thread_cpu_ms() - start_ms;
    }
  }
  for (std::size_t i = 0; i < members.size(); ++i) members[i].traffic = exchange.traffic(i);
  return members;
}

}  // namespace covey
