// SPDX-License-Identifier: Apache-2.0
#include "estimator/track_selection.h"

#include <algorithm>
#include <array>
#include <cstddef>
#include <utility>

namespace covey {
namespace {

// A landmark in each cell of a coarse grid: SLAM features should look in all directions.
constexpr int kGrid = 4;
int grid_cell(const Eigen::Vector2d& bearing) {
  const auto index = [](double x) {
    return std::clamp(static_cast<int>((x + 1) / 2 * kGrid), 0, kGrid - 1);
  };
  return index(bearing.x()) * kGrid + index(bearing.y());
}

}  // namespace

std::vector<const Track*> longest_first(std::vector<const Track*> tracks, int limit) {
  std::stable_sort(tracks.begin(), tracks.end(), [](const Track* a, const Track* b) {
    return a->observations.size() > b->observations.size();
  });
  tracks.resize(std::min(tracks.size(), static_cast<std::size_t>(limit)));
  return tracks;
}

std::vector<const Track*> ended_or_leaving(const TrackStore& store,
                                           std::optional<std::uint64_t> leaving, int limit) {
  std::vector<const Track*> chosen;
  for (const Track& track : store.tracks()) {
    const bool leaves = leaving && track.find(*leaving) != nullptr;
    if (!track.seen_now || leaves) chosen.push_back(&track);
  }
  return longest_first(std::move(chosen), limit);
}

std::vector<const Track*> slam_candidates(const TrackStore& store, const State& state,
                                          const std::vector<const Track*>& taken) {
  std::array<int, static_cast<std::size_t>(kGrid) * kGrid> in_cell{};
  for (const SlamLandmark& landmark : state.landmarks()) {
    ++in_cell[static_cast<std::size_t>(grid_cell(landmark.inverse_depth.head<2>()))];
  }
  std::vector<const Track*> chosen;
  for (const Track& track : store.tracks()) {
    const bool used = std::find(taken.begin(), taken.end(), &track) != taken.end();
    if (track.seen_now && !used && track.observations.size() >= 4) chosen.push_back(&track);
  }
  const auto crowd = [&](const Track* track) {
    return in_cell[static_cast<std::size_t>(grid_cell(track->observations.back().bearing))];
  };
  chosen = longest_first(std::move(chosen));
  std::stable_sort(chosen.begin(), chosen.end(),
                   [&](const Track* a, const Track* b) { return crowd(a) < crowd(b); });
  return chosen;
}

}  // namespace covey
