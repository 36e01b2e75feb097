// SPDX-License-Identifier: Apache-2.0
//
// The pairs of two sets that are each other's nearest.
#pragma once

#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

namespace covey {

struct IndexPair {
  std::size_t own = 0, peer = 0;
  int distance = 0;
  int second_distance = 0;  // of either to its next best, the lesser
};

class MutualMatches {
 public:
  MutualMatches(std::size_t own, std::size_t peer) : of_own_(own), of_peer_(peer) {}

  void see(std::size_t own, std::size_t peer, int distance) {
    of_own_[own].see(peer, distance);
    of_peer_[peer].see(own, distance);
  }

  // At most one pair for each index; of equals the first seen. `ratio`: the best distance must be
  // below this share of the second best, in both directions; 0 is not below 0.
  [[nodiscard]] std::vector<IndexPair> pairs(int max_distance, double ratio) const {
    std::vector<IndexPair> result;
    for (std::size_t own = 0; own < of_own_.size(); ++own) {
      const Nearest& nearest = of_own_[own];
      if (nearest.best > max_distance || !nearest.is_distinct(ratio)) continue;
      const Nearest& back = of_peer_[nearest.index];
      if (back.index != own || !back.is_distinct(ratio)) continue;
      result.push_back({own, nearest.index, nearest.best, std::min(nearest.second, back.second)});
    }
    return result;
  }

 private:
  struct Nearest {
    std::size_t index = 0;
    int best = std::numeric_limits<int>::max();
    int second = std::numeric_limits<int>::max();

    void see(std::size_t candidate, int distance) {
      if (distance < best) {
        second = best;
        best = distance;
        index = candidate;
      } else if (distance < second) {
        second = distance;
      }
    }
    [[nodiscard]] bool is_distinct(double ratio) const { return best < ratio * second; }
  };

  std::vector<Nearest> of_own_, of_peer_;
};

}  // namespace covey
