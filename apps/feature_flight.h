// SPDX-License-Identifier: Apache-2.0
//
// One drone's filter on simulated features: its odometry alone at every image, and the keyframes
// that a front-end would have taken of it. Keyframes know which landmarks they show: what place
// recognition and matching find in images is given here.
#pragma once

#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "estimator/estimator.h"
#include "frontend/keyframe_database.h"
#include "sim/feature_simulation.h"

namespace covey {

struct FlownFeature {
  std::size_t landmark = 0;  // index into FeatureSimulation::landmarks_world
  std::uint64_t track_id = 0;
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();  // as measured
  double inverse_depth = 0;                           // 1/m; 0 if it is not known
  double inverse_depth_sigma = 0;                     // 1/m
  bool slam = false;                                  // in the filter's state
};

struct FlownKeyframe {
  KeyframePose pose, before;  // by the odometry alone; see PeerKeyframe
  Eigen::Isometry3d T_world_cam_true = Eigen::Isometry3d::Identity();
  double mean_depth = 1;               // m, of what it sees
  std::vector<FlownFeature> features;  // rising landmarks
};

struct FlownImage {
  Odometry alone;
  Pose truth;
  std::optional<FlownKeyframe> keyframe;
};

class FeatureFlight {
 public:
  // Starts from the truth disturbed by a draw from what the filter is told; `drone` must outlive
  // it.
  FeatureFlight(const DroneFeatures& drone, EstimatorConfig config, const KeyframeRule& rule,
                std::uint64_t seed);

  [[nodiscard]] bool ended() const { return next_image_ == drone_.camera.size(); }
  [[nodiscard]] FlownImage next();
  // Fused in the filter itself; only for comparison, see DriftFilter.
  PeerReport fuse(const KeyframeMatch& match) { return estimator_.add_peer(match); }
  [[nodiscard]] FilterSnapshot snapshot() const { return estimator_.snapshot(); }

 private:
  void feed_imu(TimeNs until_ns);
  [[nodiscard]] FlownKeyframe keyframe(const CameraMeasurement& image, const KeyframePose& pose);

  const DroneFeatures& drone_;
  KeyframeRule rule_;
  Estimator estimator_;
  Keyframe last_;  // pose and mean depth alone
  std::size_t next_image_ = 0, next_imu_ = 0;
};

// Called after each image; what it throws ends the work.
using AfterImage = std::function<void()>;

// The whole flight.
[[nodiscard]] std::vector<FlownImage> fly_alone(const DroneFeatures& drone,
                                                const EstimatorConfig& config,
                                                const KeyframeRule& rule, std::uint64_t seed,
                                                const AfterImage& after_image = {});

}  // namespace covey
