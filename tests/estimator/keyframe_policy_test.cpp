// SPDX-License-Identifier: Apache-2.0
#include "estimator/keyframe_policy.h"

#include <gtest/gtest.h>

namespace covey {
namespace {

// Bearings of points 2 m ahead of the first camera, seen from `camera`.
TrackList seen_from(const CameraPose& camera, int first_id, int count) {
  TrackList tracks;
  for (int i = first_id; i < first_id + count; ++i) {
    const Eigen::Vector3d p_world(0.1 * (i % 7) - 0.3, 0.1 * (i % 5) - 0.2, 2);
    const Eigen::Vector3d p_cam = camera.R_world_cam.transpose() * (p_world - camera.p_world_cam);
    TrackObservation track;
    track.track_id = static_cast<std::uint64_t>(i);
    track.bearing = p_cam.hnormalized();
    tracks.push_back(track);
  }
  return tracks;
}

const CameraPose kFirst{Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero()};

TEST(KeyframePolicy, TracksAreSortedById) {
  TrackList tracks = seen_from(kFirst, 1, 3);
  std::swap(tracks[0], tracks[2]);
  const TrackList sorted = sorted_by_id(tracks);
  ASSERT_EQ(sorted.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(sorted[i].track_id, i + 1);
}

TEST(KeyframePolicy, OfTracksWithTheSameIdTheFirstCounts) {
  TrackList tracks = seen_from(kFirst, 1, 3);
  tracks.push_back(tracks[1]);
  tracks.back().bearing.x() += 1;
  const TrackList sorted = sorted_by_id(tracks);
  ASSERT_EQ(sorted.size(), 3U);
  EXPECT_EQ(sorted[1].bearing, tracks[1].bearing);
}

TEST(KeyframePolicy, ACameraThatOnlyTurnsHasNoParallax) {
  const CameraPose turned{
      Eigen::AngleAxisd(0.2, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix(),
      Eigen::Vector3d::Zero()};
  const ViewChange change =
      compare_views(seen_from(kFirst, 1, 30), kFirst, seen_from(turned, 1, 30), turned);
  EXPECT_NEAR(change.parallax, 0, 1e-12);
  EXPECT_EQ(change.shared, 1);
}

TEST(KeyframePolicy, ParallaxIsHowFarTheCameraHasMovedOverTheDepth) {
  const CameraPose moved{Eigen::Matrix3d::Identity(), Eigen::Vector3d(0.1, 0, 0)};
  const ViewChange change =
      compare_views(seen_from(kFirst, 1, 30), kFirst, seen_from(moved, 1, 30), moved);
  EXPECT_NEAR(change.parallax, 0.1 / 2, 1e-12);
}

TEST(KeyframePolicy, SharedAreThePresentTracksThatTheLastKeyframeHasSeen) {
  const ViewChange change =
      compare_views(seen_from(kFirst, 1, 30), kFirst, seen_from(kFirst, 21, 40), kFirst);
  EXPECT_NEAR(change.shared, 10.0 / 40, 1e-12);
  const ViewChange none =
      compare_views(seen_from(kFirst, 1, 30), kFirst, seen_from(kFirst, 31, 40), kFirst);
  EXPECT_EQ(none.shared, 0);
}

TEST(KeyframePolicy, AViewIsNewByParallaxByFewSharedTracksOrByAge) {
  const EstimatorConfig config;
  const double parallax = config.keyframe_parallax, shared = config.keyframe_min_shared;
  const double age = config.keyframe_max_age_s;
  EXPECT_FALSE(is_new_view(config, {0.9 * parallax, 1.1 * shared}, 0.9 * age));
  EXPECT_TRUE(is_new_view(config, {1.1 * parallax, 1.1 * shared}, 0.9 * age));
  EXPECT_TRUE(is_new_view(config, {0.9 * parallax, 0.9 * shared}, 0.9 * age));
  EXPECT_TRUE(is_new_view(config, {0.9 * parallax, 1.1 * shared}, 1.1 * age));
}

// Clones 1, 2, ... at these instants (ms).
std::vector<Clone> clones_at(const std::vector<TimeNs>& stamps_ms) {
  std::vector<Clone> clones;
  for (std::size_t i = 0; i < stamps_ms.size(); ++i) {
    Clone clone;
    clone.id = i + 1;
    clone.stamp_ns = stamps_ms[i] * 1'000'000;
    clones.push_back(clone);
  }
  return clones;
}

void add_track(TrackStore& store, std::uint64_t id, const std::vector<std::uint64_t>& clone_ids) {
  for (const std::uint64_t clone_id : clone_ids) {
    CloneObservation observation;
    observation.clone_id = clone_id;
    store.add(id, observation);
  }
}

TEST(DispensableView, IsNeverOneOfTheTwoNewest) {
  EXPECT_EQ(dispensable_view(clones_at({0, 100}), {}), std::nullopt);
  EXPECT_EQ(dispensable_view(clones_at({0, 100, 200}), {}), 0);
}

TEST(DispensableView, IsTheOneWhoseNeighboursAreClosestInTimeAndNotTheFirst) {
  EXPECT_EQ(dispensable_view(clones_at({0, 300, 400, 500, 900, 1000}), {}), 2);
}

TEST(DispensableView, IsTheOneWithoutWhichTheFewestTracksBecomeTooShort) {
  TrackStore store;
  add_track(store, 7, {1, 3, 5});
  add_track(store, 8, {1, 3, 6});
  add_track(store, 9, {1, 2, 3, 4, 5, 6});  // long enough without any of them
  EXPECT_EQ(dispensable_view(clones_at({0, 300, 400, 500, 900, 1000}), store), 1);
}

}  // namespace
}  // namespace covey
