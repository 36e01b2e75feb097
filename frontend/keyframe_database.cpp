// SPDX-License-Identifier: Apache-2.0
#include "frontend/keyframe_database.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace covey {
namespace {

double angle_between(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return Eigen::AngleAxisd(Eigen::Matrix3d(a.linear().transpose() * b.linear())).angle();
}

// How different two views are: the way between them over the depth, plus the angle.
double view_difference(const Keyframe& a, const Keyframe& b) {
  const double baseline = (a.T_world_cam.translation() - b.T_world_cam.translation()).norm();
  return 2 * baseline / (a.mean_depth + b.mean_depth) + angle_between(a.T_world_cam, b.T_world_cam);
}

}  // namespace

std::optional<double> mean_depth(const Eigen::Isometry3d& T_world_cam,
                                 const std::vector<LandmarkEstimate>& landmarks,
                                 double max_relative_sigma) {
  const Eigen::Vector3d axis_world = T_world_cam.linear().col(2);
  double sum = 0;
  int count = 0;
  for (const LandmarkEstimate& landmark : landmarks) {
    const double depth = axis_world.dot(landmark.p_world - T_world_cam.translation());
    const double variance = axis_world.dot(landmark.covariance * axis_world);
    if (!(depth > 0) || !(variance <= std::pow(max_relative_sigma * depth, 2))) continue;
    sum += depth;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

bool is_keyframe(const KeyframeRule& rule, const Keyframe& last, TimeNs stamp_ns,
                 const Eigen::Isometry3d& T_world_cam, double mean_depth) {
  if (seconds_between(last.stamp_ns, stamp_ns) < rule.min_interval_s) return false;
  const double baseline = (T_world_cam.translation() - last.T_world_cam.translation()).norm();
  return baseline > rule.baseline_over_depth * mean_depth ||
         angle_between(last.T_world_cam, T_world_cam) > rule.rotation;
}

KeyframeDatabase::KeyframeDatabase(const Config& config) : config_(config) {
  if (config.capacity < config.protected_newest + 2) {
    throw std::runtime_error(
        "keyframe database: capacity must be at least protected_newest + 2, so that there is a "
        "choice of what to forget");
  }
}

void KeyframeDatabase::add(Keyframe keyframe) {
  if (keyframes_.size() >= config_.capacity) remove(most_redundant());
  for (const KeyframeFeature& feature : keyframe.features) ++landmarks_[feature.track_id].keyframes;
  keyframes_.push_back(std::move(keyframe));
}

void KeyframeDatabase::update_landmarks(const std::vector<LandmarkEstimate>& landmarks) {
  for (const LandmarkEstimate& landmark : landmarks) {
    const auto stored = landmarks_.find(landmark.landmark_id);
    if (stored != landmarks_.end()) stored->second.estimate = landmark;
  }
}

const Keyframe* KeyframeDatabase::last() const {
  return keyframes_.empty() ? nullptr : &keyframes_.back();
}

const Keyframe* KeyframeDatabase::find(std::uint64_t keyframe_id) const {
  const auto found =
      std::find_if(keyframes_.begin(), keyframes_.end(),
                   [&](const Keyframe& keyframe) { return keyframe.id == keyframe_id; });
  return found == keyframes_.end() ? nullptr : &*found;
}

const LandmarkEstimate* KeyframeDatabase::landmark(std::uint64_t track_id) const {
  const auto found = landmarks_.find(track_id);
  if (found == landmarks_.end() || !found->second.estimate) return nullptr;
  return &*found->second.estimate;
}

void KeyframeDatabase::remove(std::size_t index) {
  for (const KeyframeFeature& feature : keyframes_[index].features) {
    const auto stored = landmarks_.find(feature.track_id);
    if (--stored->second.keyframes == 0) landmarks_.erase(stored);
  }
  keyframes_.erase(keyframes_.begin() + static_cast<std::ptrdiff_t>(index));
}

std::size_t KeyframeDatabase::most_redundant() const {
  const std::size_t candidates = keyframes_.size() - config_.protected_newest;
  std::size_t redundant = candidates - 1;
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t newer = 1; newer < candidates; ++newer) {
    for (std::size_t older = 0; older < newer; ++older) {
      const double difference = view_difference(keyframes_[newer], keyframes_[older]);
      if (difference < least) {
        least = difference;
        redundant = newer;
      }
    }
  }
  return redundant;
}

}  // namespace covey
