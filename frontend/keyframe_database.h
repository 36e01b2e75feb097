// SPDX-License-Identifier: Apache-2.0
//
// When to take a keyframe, and the keyframes taken so far with what was known of their landmarks.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/place_recognition.h"

namespace covey {

struct KeyframeRule {
  double baseline_over_depth = 0.15;  // of the way since the last keyframe to the mean depth
  double rotation = 0.35;             // rad since the last keyframe; the paper has no such rule
  double min_interval_s = 0.5;        // between two keyframes
  double fallback_depth = 10.0;       // m, while no landmark is known
  double max_relative_sigma = 0.5;    // depths less certain than this share of themselves do not
                                      // count in the mean
};

// Mean of the depths, m. Depths, not inverse depths, are averaged (Klein and Murray 2007). Nothing
// if none is certain enough.
[[nodiscard]] std::optional<double> mean_depth(const std::vector<TrackDepth>& depths,
                                               double max_relative_sigma);

struct KeyframeFeature {
  std::uint64_t track_id = 0;
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();  // (x/z, y/z) in cam
  BinaryDescriptor descriptor{};
  double inverse_depth = 0;        // 1/m; 0 if it is not known
  double inverse_depth_sigma = 0;  // 1/m
  LandmarkPatch patch{};
};

[[nodiscard]] std::vector<BinaryDescriptor> descriptors_of(
    const std::vector<KeyframeFeature>& features);

struct Keyframe {
  KeyframePose pose, before;              // as in PeerKeyframe
  double mean_depth = 1;                  // m, of what it sees
  std::vector<KeyframeFeature> features;  // rising track ids
  PlaceDescriptor place;
};

[[nodiscard]] bool is_keyframe(const KeyframeRule& rule, const KeyframePose& last, TimeNs stamp_ns,
                               const Eigen::Isometry3d& T_world_cam, double mean_depth);

// Its sigma is left 0: comparing views needs none.
[[nodiscard]] CameraView view_of(const Keyframe& keyframe);

// CameraView::sigma of the odometry at the keyframe.
[[nodiscard]] double view_sigma(const Keyframe& keyframe);

// The one of a drone's keyframes, oldest first and all before `pose`, since which depths seen at
// `pose` were measured: the newest that is `memory_s` old. Or itself, while a flight is younger
// than that: what odometry and depths are wrong by in its first moments has little in common.
template <typename Keyframes>
[[nodiscard]] KeyframePose measured_since(const Keyframes& keyframes, const KeyframePose& pose,
                                          double memory_s) {
  for (auto keyframe = keyframes.rbegin(); keyframe != keyframes.rend(); ++keyframe) {
    if (seconds_between(keyframe->pose.stamp_ns, pose.stamp_ns) >= memory_s) return keyframe->pose;
  }
  return pose;
}

// Bounded. When full, of the two keyframes with the most similar views the newer one goes
// (landmarks drift less the earlier they were mapped), so that a place stays as long as it is the
// only view of its surroundings. The newest keyframes are spared, because peers may still be
// answering them.
class KeyframeDatabase {
 public:
  struct Config {
    std::size_t capacity = 200;         // keyframes, of about 14 kB
    std::size_t protected_newest = 20;  // keyframes
  };

  explicit KeyframeDatabase(const Config& config);

  void add(Keyframe keyframe);

  [[nodiscard]] const std::deque<Keyframe>& keyframes() const { return keyframes_; }
  [[nodiscard]] const Keyframe* last() const;
  [[nodiscard]] const Keyframe* find(std::uint64_t keyframe_id) const;

 private:
  // Of a keyframe's view to that of an older one.
  [[nodiscard]] double least_difference(std::size_t index) const;
  [[nodiscard]] std::size_t most_redundant() const;
  void forget(std::size_t index);

  Config config_;
  std::deque<Keyframe> keyframes_;        // oldest first
  std::deque<double> least_differences_;  // least_difference() of each
};

}  // namespace covey
