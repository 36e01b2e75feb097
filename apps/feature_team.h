// SPDX-License-Identifier: Apache-2.0
//
// A team on simulated features: every drone's odometry corrected by its own drift filter, in the
// order in which the real pipeline does it.
#pragma once

#include <cstdint>
#include <set>
#include <string>
#include <vector>

#include "apps/feature_exchange.h"
#include "apps/feature_flight.h"
#include "apps/path_figures.h"
#include "estimator/drift_filter.h"

namespace covey {

// All drones' flights alone, images at the same stamps.
struct SoloTeam {
  std::vector<std::string> names;
  std::vector<std::vector<FlownImage>> flights;
};
[[nodiscard]] SoloTeam fly_team_alone(const FeatureSimulation& simulation,
                                      const EstimatorConfig& config, const KeyframeRule& rule,
                                      std::uint64_t seed, const AfterImage& after_image = {});

struct TeamMember {
  FlownPath path;
  Traffic traffic;
  int used = 0, gated = 0;      // relative poses
  std::set<std::string> peers;  // of whom one was used
  double fusion_cpu_ms = 0;     // relative poses and drift filter
};

// Nobody hears of anybody.
[[nodiscard]] std::vector<TeamMember> alone(const SoloTeam& team);

// Drift filters beside the odometries: the flights alone serve any number of exchanges.
[[nodiscard]] std::vector<TeamMember> fuse_jointly(const SoloTeam& team, FeatureExchange exchange,
                                                   const DriftConfig& drift, int min_matches,
                                                   const AfterImage& after_image = {});

// The same by split covariance intersection (SplitIntersection).
[[nodiscard]] std::vector<TeamMember> fuse_by_split_intersection(
    const SoloTeam& team, FeatureExchange exchange, int min_matches,
    const AfterImage& after_image = {});

// Covariance intersection inside the filters: these have to fly again.
[[nodiscard]] std::vector<TeamMember> fuse_by_intersection(
    const FeatureSimulation& simulation, const EstimatorConfig& config, const KeyframeRule& rule,
    std::uint64_t seed, FeatureExchange exchange, const AfterImage& after_image = {});

// The ceiling: from `own_start_s` on, when every drone's own filter has found its scale, one
// central filter takes over all drones of a group (CentralFilter). Each drone in one group.
[[nodiscard]] std::vector<TeamMember> fuse_centrally(
    const FeatureSimulation& simulation, const EstimatorConfig& config, const KeyframeRule& rule,
    std::uint64_t seed, const std::vector<std::vector<std::size_t>>& groups, double own_start_s,
    const AfterImage& after_image = {});

}  // namespace covey
