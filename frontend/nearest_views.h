// SPDX-License-Identifier: Apache-2.0
//
// Which places, own or peers', a keyframe is compared with.
#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <utility>
#include <vector>

namespace covey {

// Of each drone what has the most similar view, the most similar first.
template <typename Drone, typename Sight>
class NearestViews {
 public:
  NearestViews(double max_difference, int most) : max_difference_(max_difference), most_(most) {}

  void consider(const Drone& drone, double difference, const Sight& sight) {
    if (difference > max_difference_) return;
    const auto [known, added] = nearest_.emplace(drone, std::pair(difference, sight));
    if (!added && difference < known->second.first) known->second = {difference, sight};
  }

  [[nodiscard]] std::vector<Sight> take() const {
    std::vector<std::pair<double, Sight>> ranked;
    for (const auto& [drone, candidate] : nearest_) ranked.push_back(candidate);
    std::stable_sort(ranked.begin(), ranked.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    std::vector<Sight> sights;
    for (const auto& [difference, sight] : ranked) {
      if (sights.size() < static_cast<std::size_t>(most_)) sights.push_back(sight);
    }
    return sights;
  }

 private:
  double max_difference_;
  int most_;
  std::map<Drone, std::pair<double, Sight>> nearest_;
};

}  // namespace covey
