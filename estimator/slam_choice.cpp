// SPDX-License-Identifier: Apache-2.0
#include "estimator/slam_choice.h"

#include <algorithm>
#include <array>
#include <cstddef>

namespace covey {
namespace {

constexpr int kGrid = 4;  // cells of a coarse grid, either way, over bearings from -1 to 1

std::size_t grid_cell(const Eigen::Vector2d& bearing) {
  const auto index = [](double x) {
    return std::clamp(static_cast<int>((x + 1) / 2 * kGrid), 0, kGrid - 1);
  };
  return static_cast<std::size_t>(index(bearing.x()) * kGrid + index(bearing.y()));
}

}  // namespace

std::vector<const Track*> spread_over_image(std::vector<const Track*> tracks,
                                            const std::vector<Eigen::Vector2d>& taken) {
  std::array<int, static_cast<std::size_t>(kGrid) * kGrid> in_cell{};
  for (const Eigen::Vector2d& bearing : taken) ++in_cell[grid_cell(bearing)];
  const auto crowd = [&](const Track* track) -> int& {
    return in_cell[grid_cell(track->observations.back().bearing)];
  };
  const auto comes_before = [&](const Track* a, const Track* b) {
    if (crowd(a) != crowd(b)) return crowd(a) < crowd(b);
    return a->observations.size() > b->observations.size();
  };
  for (auto next = tracks.begin(); next != tracks.end(); ++next) {
    const auto best = std::min_element(next, tracks.end(), comes_before);
    std::rotate(next, best, best + 1);  // the others keep their order
    ++crowd(*next);
  }
  return tracks;
}

}  // namespace covey
