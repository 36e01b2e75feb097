// SPDX-License-Identifier: Apache-2.0
#include "estimator/slam_choice.h"

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

namespace covey {
namespace {

const Eigen::Vector2d kLeft(-0.7, -0.1), kRight(0.7, 0.1);

Track seen(std::uint64_t id, std::size_t images, const Eigen::Vector2d& now) {
  Track track{id, true, std::vector<CloneObservation>(images)};
  track.observations.back().bearing = now;
  return track;
}

std::vector<std::uint64_t> order(const std::vector<Track>& tracks,
                                 const std::vector<Eigen::Vector2d>& taken) {
  std::vector<const Track*> pointers;
  for (const Track& track : tracks) pointers.push_back(&track);
  std::vector<std::uint64_t> ids;
  for (const Track* track : spread_over_image(pointers, taken)) ids.push_back(track->id);
  return ids;
}

using Ids = std::vector<std::uint64_t>;

TEST(SlamChoice, TheLongestTracksOfOnePlaceComeFirst) {
  EXPECT_EQ(order({seen(1, 4, kLeft), seen(2, 9, kLeft), seen(3, 4, kLeft)}, {}), Ids({2, 1, 3}));
}

TEST(SlamChoice, WhereThereAreFeaturesOthersComeLater) {
  EXPECT_EQ(order({seen(1, 9, kLeft), seen(2, 4, kRight)}, {kLeft}), Ids({2, 1}));
}

// Three long tracks on one side do not take all the room.
TEST(SlamChoice, WhatIsChosenCountsForTheNextChoice) {
  const std::vector<Track> tracks{seen(1, 9, kLeft), seen(2, 8, kLeft), seen(3, 7, kLeft),
                                  seen(4, 5, kRight), seen(5, 4, kRight)};
  EXPECT_EQ(order(tracks, {}), Ids({1, 4, 2, 5, 3}));
}

}  // namespace
}  // namespace covey
