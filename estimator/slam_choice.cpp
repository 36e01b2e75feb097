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

struct Cell {
  int features = 0;
  std::vector<const Track*> waiting;  // the next one last
};
using Cells = std::array<Cell, static_cast<std::size_t>(kGrid) * kGrid>;

Cells sorted_into_cells(const std::vector<const Track*>& tracks,
                        const std::vector<Eigen::Vector2d>& taken) {
  Cells cells;
  for (const Eigen::Vector2d& bearing : taken) ++cells[grid_cell(bearing)].features;
  for (const Track* track : tracks) {
    cells[grid_cell(track->observations.back().bearing)].waiting.push_back(track);
  }
  for (Cell& cell : cells) {
    std::reverse(cell.waiting.begin(), cell.waiting.end());
    std::stable_sort(cell.waiting.begin(), cell.waiting.end(), [](const Track* a, const Track* b) {
      return a->observations.size() < b->observations.size();
    });
  }
  return cells;
}

bool comes_before(const Cell& a, const Cell& b) {
  if (a.waiting.empty() || b.waiting.empty()) return !a.waiting.empty();
  if (a.features != b.features) return a.features < b.features;
  return a.waiting.back()->observations.size() > b.waiting.back()->observations.size();
}

}  // namespace

std::vector<const Track*> spread_over_image(const std::vector<const Track*>& tracks,
                                            const std::vector<Eigen::Vector2d>& taken) {
  Cells cells = sorted_into_cells(tracks, taken);
  std::vector<const Track*> spread;
  spread.reserve(tracks.size());
  while (spread.size() < tracks.size()) {
    Cell& next = *std::min_element(cells.begin(), cells.end(), comes_before);
    spread.push_back(next.waiting.back());
    next.waiting.pop_back();
    ++next.features;
  }
  return spread;
}

}  // namespace covey
