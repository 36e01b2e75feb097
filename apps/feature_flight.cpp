// SPDX-License-Identifier: Apache-2.0
#include "apps/feature_flight.h"

#include <algorithm>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "apps/camera_pose.h"
#include "apps/disturbed_start.h"

namespace covey {
namespace {

EstimatorConfig calibrated(EstimatorConfig config, const CameraExtrinsics& extrinsics) {
  config.extrinsics = extrinsics;
  return config;
}

}  // namespace

FeatureFlight::FeatureFlight(const DroneFeatures& drone, EstimatorConfig config,
                             const KeyframeRule& rule, std::uint64_t seed)
    : drone_(drone), rule_(rule), estimator_(calibrated(std::move(config), drone.extrinsics)) {
  estimator_.initialize(disturbed_start(drone, drone.truth.front().bias, seed));
}

void FeatureFlight::feed_imu(TimeNs until_ns) {
  while (next_imu_ < drone_.imu.size() && drone_.imu[next_imu_].stamp_ns <= until_ns) {
    estimator_.add_imu(drone_.imu[next_imu_++]);
  }
}

FlownImage FeatureFlight::next() {
  constexpr TimeNs kBeyondImage_ns = 40'000'000;
  const CameraMeasurement& image = drone_.camera[next_image_];
  FlownImage flown;
  flown.truth = drone_.truth[next_image_].state.pose;
  feed_imu(image.stamp_ns + kBeyondImage_ns);
  (void)estimator_.add_camera(image);
  flown.alone = estimator_.odometry();
  flown.alone.stamp_ns = image.stamp_ns;

  const std::optional<CameraEstimate> camera = estimator_.camera();
  const bool first = last_.pose.keyframe_id == 0;
  if (flown.alone.status == FilterStatus::kTracking && camera &&
      (first ||
       is_keyframe(rule_, last_.pose, image.stamp_ns, camera->T_world_cam, last_.mean_depth))) {
    flown.keyframe = keyframe(image, {last_.pose.keyframe_id + 1, image.stamp_ns,
                                      camera->T_world_cam, camera->covariance});
    flown.keyframe->T_world_cam_true = camera_in_world(flown.truth, drone_.extrinsics);
  }
  ++next_image_;
  return flown;
}

FlownKeyframe FeatureFlight::keyframe(const CameraMeasurement& image, const KeyframePose& pose) {
  const std::vector<TrackDepth> depths = estimator_.depths();
  std::unordered_map<std::uint64_t, const TrackDepth*> depth_of;
  for (const TrackDepth& depth : depths) depth_of[depth.track_id] = &depth;
  const std::vector<std::uint64_t> slam_tracks = estimator_.slam_tracks();
  const std::unordered_set<std::uint64_t> slam(slam_tracks.begin(), slam_tracks.end());

  FlownKeyframe keyframe;
  keyframe.pose = pose;
  keyframe.mean_depth = mean_depth(depths, rule_.max_relative_sigma).value_or(rule_.fallback_depth);
  for (const TrackObservation& track : image.tracks) {
    FlownFeature feature{drone_.landmark_of_track.at(track.track_id),
                         track.track_id,
                         track.bearing,
                         0,
                         0,
                         slam.count(track.track_id) > 0};
    if (const auto known = depth_of.find(track.track_id); known != depth_of.end()) {
      feature.inverse_depth = known->second->inverse_depth;
      feature.inverse_depth_sigma = known->second->inverse_depth_sigma;
    }
    keyframe.features.push_back(feature);
  }
  std::sort(keyframe.features.begin(), keyframe.features.end(),
            [](const FlownFeature& a, const FlownFeature& b) { return a.landmark < b.landmark; });
  last_.pose = pose;
  last_.mean_depth = keyframe.mean_depth;
  return keyframe;
}

std::vector<FlownImage> fly_alone(const DroneFeatures& drone, const EstimatorConfig& config,
                                  const KeyframeRule& rule, std::uint64_t seed,
                                  const AfterImage& after_image) {
  FeatureFlight flight(drone, config, rule, seed);
  std::vector<FlownImage> images;
  while (!flight.ended()) {
    images.push_back(flight.next());
    if (after_image) after_image();
  }
  return images;
}

}  // namespace covey
