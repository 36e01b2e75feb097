// SPDX-License-Identifier: Apache-2.0
#include "estimator/keyframe_policy.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

#include "estimator/median.h"
#include "estimator/track_rows.h"

namespace covey {

TrackList sorted_by_id(const std::vector<TrackObservation>& tracks) {
  TrackList sorted = tracks;
  std::stable_sort(
      sorted.begin(), sorted.end(),
      [](const TrackObservation& a, const TrackObservation& b) { return a.track_id < b.track_id; });
  const auto end = std::unique(sorted.begin(), sorted.end(),
                               [](const TrackObservation& a, const TrackObservation& b) {
                                 return a.track_id == b.track_id;
                               });
  sorted.erase(end, sorted.end());
  return sorted;
}

ViewChange compare_views(const TrackList& reference, const CameraPose& reference_camera,
                         const TrackList& present, const CameraPose& present_camera) {
  const Eigen::Matrix3d R_reference_present =
      reference_camera.R_world_cam.transpose() * present_camera.R_world_cam;
  std::vector<double> motions;
  motions.reserve(present.size());
  auto old = reference.begin();
  for (const TrackObservation& track : present) {
    while (old != reference.end() && old->track_id < track.track_id) ++old;
    if (old == reference.end() || old->track_id != track.track_id) continue;
    const Eigen::Vector3d turned = R_reference_present * track.bearing.homogeneous();
    if (turned.z() < 1e-3) continue;
    motions.push_back((turned.head<2>() / turned.z() - old->bearing).norm());
  }
  if (motions.empty()) return {};
  const double shared = static_cast<double>(motions.size()) / static_cast<double>(present.size());
  return {median(std::move(motions)), shared};
}

bool is_new_view(const EstimatorConfig& config, const ViewChange& change, double age_s) {
  return change.parallax > config.keyframe_parallax || change.shared < config.keyframe_min_shared ||
         age_s > config.keyframe_max_age_s;
}

std::optional<int> dispensable_view(const std::vector<Clone>& clones, const TrackStore& store) {
  const auto too_short = [&](const Clone& clone) {
    return std::count_if(store.tracks().begin(), store.tracks().end(), [&](const Track& track) {
      return track.observations.size() == kMinObservations && track.find(clone.id) != nullptr;
    });
  };
  const auto span_s = [&](int index) {
    const auto at = [&](int i) { return clones[static_cast<std::size_t>(i)].stamp_ns; };
    return index == 0 ? std::numeric_limits<double>::infinity()
                      : seconds_between(at(index - 1), at(index + 1));
  };
  std::optional<int> dispensable;
  std::pair<std::ptrdiff_t, double> least;
  for (int i = 0; i + 2 < static_cast<int>(clones.size()); ++i) {
    const std::pair cost(too_short(clones[static_cast<std::size_t>(i)]), span_s(i));
    if (dispensable && !(cost < least)) continue;
    dispensable = i;
    least = cost;
  }
  return dispensable;
}

}  // namespace covey
