// SPDX-License-Identifier: Apache-2.0
#include "estimator/keyframe_policy.h"

#include <algorithm>
#include <utility>

#include "estimator/median.h"

namespace covey {

TrackList sorted_by_id(const std::vector<TrackObservation>& tracks) {
  TrackList sorted = tracks;
  std::sort(sorted.begin(), sorted.end(), [](const TrackObservation& a, const TrackObservation& b) {
    return a.track_id < b.track_id;
  });
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

}  // namespace covey
