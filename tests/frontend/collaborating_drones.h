// SPDX-License-Identifier: Apache-2.0
//
// Drones that look at made-up places and ask each other about them.
#pragma once

#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <variant>

#include "frontend/collaborator.h"
#include "frontend/vocabulary_visual.h"
#include "synthetic_places.h"

namespace covey::testing {

constexpr double kFocal = 455;  // px
inline CameraIntrinsics camera() {
  CameraIntrinsics camera;
  camera.width = 752;
  camera.height = 480;
  camera.fx = camera.fy = kFocal;
  camera.cx = 375.5;
  camera.cy = 239.5;
  return camera;
}

constexpr std::uint64_t kOwnIds = 1000, kPeerIds = 5000;

inline Collaborator make_drone(const std::string& name, PlaceMode mode = PlaceMode::kCompact) {
  CollaboratorConfig config;
  config.agent = name;
  config.place_mode = mode;
  return Collaborator(config, visual_vocabulary(), camera());
}

inline Collaborator make_drone(const std::string& name, ExchangeMode exchange) {
  CollaboratorConfig config;
  config.agent = name;
  config.exchange = exchange;
  config.place_threshold = 0.1;
  config.recent_frames = 3;
  return Collaborator(config, visual_vocabulary(), camera());
}

inline Matrix6d pose_covariance() { return 1e-4 * Matrix6d::Identity(); }

// The drone takes one keyframe of the scene and knows the depths of all it sees.
inline PlaceAdvert look(Collaborator& drone, const Scene& scene,
                        const Eigen::Isometry3d& T_world_cam, double seconds,
                        std::uint64_t first_id) {
  const TimeNs stamp_ns = nanoseconds(seconds);
  const auto seed = static_cast<unsigned>(first_id);
  drone.set_time(stamp_ns);
  return drone.add_keyframe(view(scene, T_world_cam, stamp_ns, first_id, {}, seed + 1), {},
                            T_world_cam, pose_covariance(),
                            depths(scene, T_world_cam, first_id, 0.003, seed));
}

// An image that is no keyframe.
inline PlaceAdvert glance(Collaborator& drone, const Scene& scene,
                          const Eigen::Isometry3d& T_world_cam, double seconds,
                          std::uint64_t first_id) {
  const TimeNs stamp_ns = nanoseconds(seconds);
  const auto seed = static_cast<unsigned>(first_id);
  return drone.add_frame(view(scene, T_world_cam, stamp_ns, first_id, {}, seed + 1), {},
                         T_world_cam, pose_covariance(),
                         depths(scene, T_world_cam, first_id, 0.003, seed));
}

inline NoMatchReason reason_of(const std::variant<KeyframeMatch, NoMatch>& result) {
  const auto* none = std::get_if<NoMatch>(&result);
  EXPECT_NE(none, nullptr) << "matched, but should not have";
  return none ? none->reason : NoMatchReason::kMalformed;
}

// uav0 asks from 1.5 m aside of where uav1 looked at the same wall.
struct Team {
  explicit Team(PlaceMode mode = PlaceMode::kCompact)
      : uav0(make_drone("uav0", mode)), uav1(make_drone("uav1", mode)) {
    look(uav1, scene, looked_at, 1.0, kPeerIds);
    advert = look(uav0, scene, level_camera({0.5, 1.5, 0.3}, 0.1), 3.0, kOwnIds);
  }
  [[nodiscard]] PeerKeyframe ask() { return uav1.answer(advert).value(); }

  Scene scene = make_scene(80, {12, 0, 0}, 42);
  Eigen::Isometry3d looked_at = level_camera({0, 0, 0});
  Collaborator uav0, uav1;
  PlaceAdvert advert;
};

// Between the point that the peer means and the one that the own track is, m.
inline double distance_to_own_point(const Team& team, const LandmarkMatch& match) {
  const Eigen::Vector3d p_world =
      team.looked_at * (match.other_bearing.homogeneous() / match.inverse_depth).eval();
  return (p_world - team.scene[match.track_id - kOwnIds].p_world).norm();
}

}  // namespace covey::testing
