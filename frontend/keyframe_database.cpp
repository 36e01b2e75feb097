// SPDX-License-Identifier: Apache-2.0
#include "frontend/keyframe_database.h"

#include <algorithm>
#include <limits>
#include <stdexcept>

#include "frontend/depth_refinement.h"

namespace covey {
namespace {

double angle_between(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return Eigen::AngleAxisd(Eigen::Matrix3d(a.linear().transpose() * b.linear())).angle();
}

double way_between(const Eigen::Isometry3d& a, const Eigen::Isometry3d& b) {
  return (a.translation() - b.translation()).norm();
}

}  // namespace

CameraView view_of(const Keyframe& keyframe) {
  return {keyframe.pose.T_world_cam, keyframe.mean_depth};
}

double view_sigma(const Keyframe& keyframe) {
  const Matrix6d& covariance = keyframe.pose.covariance;
  const double position = std::sqrt(covariance.topLeftCorner<3, 3>().trace());
  const double attitude = std::sqrt(covariance.bottomRightCorner<3, 3>().trace());
  return position / keyframe.mean_depth + attitude;
}

std::optional<double> mean_depth(const std::vector<TrackDepth>& depths, double max_relative_sigma) {
  double sum = 0;
  int count = 0;
  for (const TrackDepth& depth : depths) {
    if (!(depth.inverse_depth > 0)) continue;
    if (!(depth.inverse_depth_sigma <= max_relative_sigma * depth.inverse_depth)) continue;
    sum += 1 / depth.inverse_depth;
    ++count;
  }
  if (count == 0) return std::nullopt;
  return sum / count;
}

std::vector<BinaryDescriptor> descriptors_of(const std::vector<KeyframeFeature>& features) {
  std::vector<BinaryDescriptor> descriptors;
  descriptors.reserve(features.size());
  for (const KeyframeFeature& feature : features) descriptors.push_back(feature.descriptor);
  return descriptors;
}

bool is_keyframe(const KeyframeRule& rule, const KeyframePose& last, TimeNs stamp_ns,
                 const Eigen::Isometry3d& T_world_cam, double mean_depth) {
  if (seconds_between(last.stamp_ns, stamp_ns) < rule.min_interval_s) return false;
  const double baseline = way_between(T_world_cam, last.T_world_cam);
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
  if (keyframes_.size() >= config_.capacity) forget(most_redundant());
  refine_newest(keyframes_, config_.protected_newest, keyframe,
                [](const KeyframeFeature& feature) { return feature.track_id; });
  keyframes_.push_back(std::move(keyframe));
  least_differences_.push_back(least_difference(keyframes_.size() - 1));
}

const Keyframe* KeyframeDatabase::last() const {
  return keyframes_.empty() ? nullptr : &keyframes_.back();
}

const Keyframe* KeyframeDatabase::find(std::uint64_t keyframe_id) const {
  const auto found = std::find_if(
      keyframes_.begin(), keyframes_.end(),
      [&](const Keyframe& keyframe) { return keyframe.pose.keyframe_id == keyframe_id; });
  return found == keyframes_.end() ? nullptr : &*found;
}

double KeyframeDatabase::least_difference(std::size_t index) const {
  const CameraView view = view_of(keyframes_[index]);
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t older = 0; older < index; ++older) {
    least = std::min(least, view_difference(view, view_of(keyframes_[older])));
  }
  return least;
}

std::size_t KeyframeDatabase::most_redundant() const {
  const std::size_t candidates = keyframes_.size() - config_.protected_newest;
  const auto first = least_differences_.begin();
  return static_cast<std::size_t>(
      std::min_element(first, first + static_cast<std::ptrdiff_t>(candidates)) - first);
}

// Those whose most similar older view it was look for another.
void KeyframeDatabase::forget(std::size_t index) {
  const auto offset = static_cast<std::ptrdiff_t>(index);
  const CameraView gone = view_of(keyframes_[index]);
  keyframes_.erase(keyframes_.begin() + offset);
  least_differences_.erase(least_differences_.begin() + offset);
  for (std::size_t newer = index; newer < keyframes_.size(); ++newer) {
    double& least = least_differences_[newer];
    if (view_difference(view_of(keyframes_[newer]), gone) <= least) least = least_difference(newer);
  }
}

}  // namespace covey
