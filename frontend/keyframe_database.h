// SPDX-License-Identifier: Apache-2.0
//
// When to take a keyframe, and the keyframes taken so far with what is known of their landmarks.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <unordered_map>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/place_recognition.h"

namespace covey {

struct KeyframeRule {
  double baseline_over_depth = 0.15;  // of the way since the last keyframe to the mean depth
  double rotation = 0.35;             // rad since the last keyframe; the paper has no such rule
  double min_interval_s = 0.5;        // between two keyframes
  double fallback_depth = 10.0;       // m, while no landmark is known
  double max_relative_sigma = 0.5;    // landmarks less certain than this share of their depth
                                      // do not count in the mean
};

// Mean of the landmarks' depths in the camera, m. Depths, not inverse depths, are averaged (Klein
// and Murray 2007). Nothing if no landmark is in front of the camera and certain enough.
[[nodiscard]] std::optional<double> mean_depth(const Eigen::Isometry3d& T_world_cam,
                                               const std::vector<LandmarkEstimate>& landmarks,
                                               double max_relative_sigma);

struct KeyframeFeature {
  std::uint64_t track_id = 0;
  Eigen::Vector2d bearing = Eigen::Vector2d::Zero();  // (x/z, y/z) in cam
  BinaryDescriptor descriptor{};
};

struct Keyframe {
  std::uint64_t id = 0;
  TimeNs stamp_ns = 0;
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();  // as estimated when it was taken
  double mean_depth = 1;                                          // m, of what it sees
  std::vector<KeyframeFeature> features;
  PlaceDescriptor place;
};

[[nodiscard]] bool is_keyframe(const KeyframeRule& rule, const Keyframe& last, TimeNs stamp_ns,
                               const Eigen::Isometry3d& T_world_cam, double mean_depth);

// Bounded. When full, of the two keyframes with the most similar views the newer one goes
// (landmarks drift less the earlier they were mapped), so that a place stays as long as it is the
// only view of its surroundings. The newest keyframes are spared, because peers may still be
// answering them.
class KeyframeDatabase {
 public:
  struct Config {
    std::size_t capacity = 200;         // keyframes, of about 15 kB
    std::size_t protected_newest = 20;  // keyframes
  };

  explicit KeyframeDatabase(const Config& config);

  void add(Keyframe keyframe);

  // The newest estimate of each track replaces the one before and outlives the track in the filter.
  // Tracks that are in no stored keyframe are ignored.
  void update_landmarks(const std::vector<LandmarkEstimate>& landmarks);

  [[nodiscard]] const std::deque<Keyframe>& keyframes() const { return keyframes_; }
  [[nodiscard]] const Keyframe* last() const;
  [[nodiscard]] const Keyframe* find(std::uint64_t keyframe_id) const;
  // Null if the track is in no stored keyframe or was never estimated.
  [[nodiscard]] const LandmarkEstimate* landmark(std::uint64_t track_id) const;

 private:
  struct StoredLandmark {
    int keyframes = 0;  // that hold the track
    std::optional<LandmarkEstimate> estimate;
  };
  void remove(std::size_t index);
  [[nodiscard]] std::size_t most_redundant() const;

  Config config_;
  std::deque<Keyframe> keyframes_;  // oldest first
  std::unordered_map<std::uint64_t, StoredLandmark> landmarks_;
};

}  // namespace covey
