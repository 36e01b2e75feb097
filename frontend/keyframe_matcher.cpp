// SPDX-License-Identifier: Apache-2.0
#include "frontend/keyframe_matcher.h"

#include <algorithm>
#include <iterator>
#include <utility>

#include "frontend/viewpoint_tolerance.h"

namespace covey {
namespace {

template <typename Landmark>
std::vector<Landmark> certain_ones(const std::vector<Landmark>& landmarks,
                                   double max_relative_sigma) {
  std::vector<Landmark> certain;
  std::copy_if(landmarks.begin(), landmarks.end(), std::back_inserter(certain),
               [&](const Landmark& landmark) {
                 return is_certain(landmark.inverse_depth, landmark.inverse_depth_sigma,
                                   max_relative_sigma);
               });
  return certain;
}

template <typename Features>
std::vector<ShortDescriptor> short_descriptors_of(const Features& features) {
  std::vector<ShortDescriptor> descriptors;
  descriptors.reserve(features.size());
  for (const auto& feature : features) descriptors.push_back(feature.descriptor);
  return descriptors;
}

std::vector<OwnFeature> features_of(const Keyframe& own) {
  std::vector<OwnFeature> features;
  features.reserve(own.features.size());
  for (const KeyframeFeature& feature : own.features) {
    features.push_back({feature.bearing, shortened(feature.descriptor)});
  }
  return features;
}

// In the own world, as far as the other camera's pose is right in it.
std::vector<PeerPoint> points_of(const Eigen::Isometry3d& T_world_other,
                                 const std::vector<PeerLandmark>& seen) {
  std::vector<PeerPoint> points;
  points.reserve(seen.size());
  for (const PeerLandmark& landmark : seen) {
    points.push_back(
        {T_world_other * (landmark.bearing.homogeneous() / landmark.inverse_depth).eval(),
         landmark.descriptor});
  }
  return points;
}

// Camera to camera, once it is known by how much the other one's pose is wrong.
Eigen::Isometry3d relative_pose(const Eigen::Isometry3d& T_world_own,
                                const Eigen::Isometry3d& T_world_other, const FrameOffset& offset) {
  const Eigen::Vector3d c = T_world_own.translation();
  Eigen::Isometry3d correction = Eigen::Isometry3d::Identity();
  correction.linear() = Eigen::AngleAxisd(offset.yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  correction.translation() = to_own_world(offset, c, Eigen::Vector3d::Zero());
  return (correction * T_world_other).inverse() * T_world_own;
}

template <typename Search>
std::size_t number_found(const std::vector<Search>& searches) {
  return static_cast<std::size_t>(std::count_if(searches.begin(), searches.end(),
                                                [](const Search& search) { return search.found; }));
}

Eigen::Matrix2d alike_in_both(double sigma) { return sigma * sigma * Eigen::Matrix2d::Identity(); }

// The bearing is that in the own keyframe.
LandmarkMatch seen_at(const Eigen::Vector2d& bearing, const PeerLandmark& landmark) {
  LandmarkMatch match;
  match.bearing = bearing;
  match.other_bearing = landmark.bearing;
  match.inverse_depth = landmark.inverse_depth;
  match.inverse_depth_sigma = landmark.inverse_depth_sigma;
  return match;
}

NoMatchReason to_reason(VerificationFailure failure) {
  switch (failure) {
    case VerificationFailure::kTooFewCorrespondences:
      return NoMatchReason::kTooFewMatches;
    case VerificationFailure::kOffsetTooLarge:
      return NoMatchReason::kOffsetTooLarge;
    case VerificationFailure::kTooFewInliers:
    case VerificationFailure::kUndetermined:
      break;
  }
  return NoMatchReason::kTooFewInliers;
}

}  // namespace

const char* to_string(NoMatchReason reason) {
  switch (reason) {
    case NoMatchReason::kNotForUs:
      return "not for us";
    case NoMatchReason::kMalformed:
      return "malformed";
    case NoMatchReason::kUnknownRequest:
      return "unknown request";
    case NoMatchReason::kTooFewMatches:
      return "too few descriptor matches";
    case NoMatchReason::kTooFewInliers:
      return "too few geometric inliers";
    case NoMatchReason::kOffsetTooLarge:
      return "offset between the worlds too large";
    case NoMatchReason::kTooFewFound:
      break;
  }
  return "too few landmarks found where they should be";
}

bool is_certain(double inverse_depth, double inverse_depth_sigma, double max_relative_sigma) {
  return inverse_depth > 0 && inverse_depth_sigma >= 0 &&
         inverse_depth_sigma <= max_relative_sigma * inverse_depth;
}

std::vector<KeyframeFeature> landmarks_of(const Keyframe& keyframe, double max_relative_sigma) {
  return certain_ones(keyframe.features, max_relative_sigma);
}

std::vector<PeerLandmark> landmarks_of(const PeerKeyframe& keyframe, double max_relative_sigma) {
  return certain_ones(keyframe.landmarks, max_relative_sigma);
}

ShortDescriptor shortened(const BinaryDescriptor& descriptor) {
  ShortDescriptor first{};
  std::copy_n(descriptor.begin(), first.size(), first.begin());
  return first;
}

KeyframeMatcher::KeyframeMatcher(const KeyframeMatcherConfig& config,
                                 const CameraIntrinsics& camera)
    : config_(config), camera_(camera) {}

void KeyframeMatcher::keep_image(std::uint64_t keyframe_id, const ImagePyramid& image) {
  if (images_.size() >= config_.images) images_.pop_front();
  images_.emplace_back(keyframe_id, image);
}

void KeyframeMatcher::know_world(const std::string& drone, const Eigen::Isometry3d& T_own_drone) {
  worlds_[drone].known = T_own_drone;
}

void KeyframeMatcher::suppose_world(const std::string& drone,
                                    const Eigen::Isometry3d& T_own_drone) {
  worlds_[drone].supposed = T_own_drone;
}

bool KeyframeMatcher::has_started_anew(const std::string& drone, std::uint64_t keyframe_id) const {
  const auto known = worlds_.find(drone);
  return known != worlds_.end() && keyframe_id < known->second.newest_keyframe;
}

void KeyframeMatcher::note_keyframe(const std::string& drone, std::uint64_t keyframe_id) {
  if (has_started_anew(drone, keyframe_id)) worlds_.erase(drone);
  const auto known = worlds_.find(drone);
  if (known != worlds_.end()) known->second.newest_keyframe = keyframe_id;
}

bool KeyframeMatcher::knows_world(const std::string& drone) const {
  const auto world = worlds_.find(drone);
  return world != worlds_.end() && world->second.known;
}

std::optional<Eigen::Isometry3d> KeyframeMatcher::world_of(const std::string& drone) const {
  if (knows_world(drone)) return worlds_.at(drone).known;
  if (config_.common_start) return Eigen::Isometry3d::Identity();
  return std::nullopt;
}

std::optional<Eigen::Isometry3d> KeyframeMatcher::likely_world_of(const std::string& drone) const {
  const std::optional<Eigen::Isometry3d> known = world_of(drone);
  const auto world = worlds_.find(drone);
  return known || world == worlds_.end() ? known : world->second.supposed;
}

double KeyframeMatcher::start_sigma_at(const std::string& drone,
                                       const Eigen::Vector3d& p_world) const {
  if (knows_world(drone)) return 0;
  return config_.start_position_sigma + config_.start_yaw_sigma * (p_world - p_start_).norm();
}

double KeyframeMatcher::start_yaw_sigma(const std::string& drone) const {
  return knows_world(drone) ? 0 : config_.start_yaw_sigma;
}

VerificationConfig KeyframeMatcher::limits(const Keyframe& own, const std::string& other) const {
  constexpr double kSigmas = 3;
  VerificationConfig config = config_.verification;
  config.max_offset += kSigmas * start_sigma_at(other, own.pose.T_world_cam.translation());
  config.max_yaw += kSigmas * start_yaw_sigma(other);
  return config;
}

// First among corners that lie about where they are expected, then anywhere.
VerificationResult KeyframeMatcher::verify_pairs(const Keyframe& own,
                                                 const std::vector<OwnFeature>& features,
                                                 const std::vector<PeerPoint>& points,
                                                 const VerificationConfig& config) const {
  const Eigen::Isometry3d& T_world_cam = own.pose.T_world_cam;
  const auto verified = [&](const std::vector<IndexPair>& pairs) {
    std::vector<Correspondence> correspondences;
    correspondences.reserve(pairs.size());
    for (const IndexPair& pair : pairs) {
      correspondences.push_back({points[pair.peer].p_world, features[pair.own].bearing});
    }
    return verify(T_world_cam, correspondences, camera_, config);
  };
  const VerificationResult nearby =
      verified(match_guided(T_world_cam, FrameOffset{}, features, points, camera_,
                            {config_.drift_px, config_.descriptors.max_distance_bits}));
  if (nearby.verified) return nearby;
  return verified(match_descriptors(short_descriptors_of(features), short_descriptors_of(points),
                                    config_.descriptors));
}

// By what the landmarks look like, where the other's pose says they must be. Chance finds scatter
// over the whole reach of the search, so they have to agree much better than that.
VerificationResult KeyframeMatcher::verify_in_place(const Keyframe& own,
                                                    const std::vector<PeerPoint>& points,
                                                    const std::vector<Search>& searches,
                                                    VerificationConfig config) const {
  std::vector<Correspondence> correspondences;
  for (std::size_t i = 0; i < searches.size(); ++i) {
    if (!searches[i].found) continue;
    correspondences.push_back({points[i].p_world, searches[i].found->bearing});
  }
  config.inlier_px = config_.in_place_px;
  config.min_inlier_share = config_.in_place_share;
  config.min_inliers = config_.min_matches;
  return verify(own.pose.T_world_cam, correspondences, camera_, config);
}

std::variant<KeyframeMatch, NoMatch> KeyframeMatcher::match(const Keyframe& own,
                                                            const PeerKeyframe& other) const {
  const std::vector<PeerLandmark> landmarks = landmarks_of(other, config_.max_relative_sigma);
  const Eigen::Isometry3d T_world_other =
      world_of(other.sender).value_or(Eigen::Isometry3d::Identity()) * other.pose.T_world_cam;
  const std::vector<PeerPoint> points = points_of(T_world_other, landmarks);
  const std::vector<OwnFeature> features = features_of(own);
  std::vector<Search> searches = look_where_expected(own, other, landmarks);
  const VerificationConfig verification = limits(own, other.sender);
  VerificationResult result = verify_in_place(own, points, searches, verification);
  const bool in_place = result.verified.has_value();
  if (!in_place && other.described) result = verify_pairs(own, features, points, verification);
  if (!result.verified) return NoMatch{to_reason(result.failure)};
  const FrameOffset& offset = result.verified->offset;
  const Eigen::Isometry3d T_other_own = relative_pose(own.pose.T_world_cam, T_world_other, offset);
  const auto match_in_reach = other.described ? match_guided : match_nearest;
  const std::vector<IndexPair> pairs =
      match_in_reach(own.pose.T_world_cam, offset, features, points, camera_, config_.guided);
  searches = look_for(own.pose.keyframe_id, other, landmarks, T_other_own, std::move(searches));
  const std::size_t count = in_place ? number_found(searches) : pairs.size();
  if (count < static_cast<std::size_t>(config_.min_matches)) {
    return NoMatch{NoMatchReason::kTooFewMatches};
  }
  KeyframeMatch match{other.sender, own.pose, own.before, own.mean_depth, other.pose, other.before,
                      T_other_own,  {},       {}};
  match.matches = matches_of(own, landmarks, pairs);
  match.aligned = aligned_of(own, landmarks, pairs, searches);
  return match;
}

std::vector<KeyframeMatcher::Search> KeyframeMatcher::look_where_expected(
    const Keyframe& own, const PeerKeyframe& other,
    const std::vector<PeerLandmark>& landmarks) const {
  const std::optional<Eigen::Isometry3d> T_own_drone = likely_world_of(other.sender);
  if (!T_own_drone) return {};
  const Eigen::Isometry3d T_other_own =
      (*T_own_drone * other.pose.T_world_cam).inverse() * own.pose.T_world_cam;
  return look_for(own.pose.keyframe_id, other, landmarks, T_other_own, {});
}

std::vector<LandmarkMatch> KeyframeMatcher::matches_of(const Keyframe& own,
                                                       const std::vector<PeerLandmark>& landmarks,
                                                       const std::vector<IndexPair>& pairs) const {
  const Eigen::Matrix2d corner_px = alike_in_both(config_.sigma_px);
  std::vector<LandmarkMatch> matches;
  for (const IndexPair& pair : pairs) {
    const KeyframeFeature& feature = own.features[pair.own];
    LandmarkMatch match = seen_at(feature.bearing, landmarks[pair.peer]);
    match.track_id = feature.track_id;
    match.bearing_covariance = bearing_covariance(camera_, feature.bearing, corner_px);
    add_own_depth(feature, config_.max_relative_sigma, match);
    matches.push_back(match);
  }
  return matches;
}

std::vector<LandmarkMatch> KeyframeMatcher::aligned_of(const Keyframe& own,
                                                       const std::vector<PeerLandmark>& landmarks,
                                                       const std::vector<IndexPair>& pairs,
                                                       const std::vector<Search>& searches) const {
  const Eigen::Matrix2d aligned_px = alike_in_both(config_.aligned_sigma_px);
  const double scale = config_.aligned_scale;
  std::vector<const KeyframeFeature*> corner_of(landmarks.size(), nullptr);
  for (const IndexPair& pair : pairs) corner_of[pair.peer] = &own.features[pair.own];
  std::vector<LandmarkMatch> aligned;
  aligned.reserve(number_found(searches));
  for (std::size_t i = 0; i < searches.size(); ++i) {
    if (!searches[i].found) continue;
    const FoundPatch& patch = *searches[i].found;
    LandmarkMatch match = seen_at(patch.bearing, landmarks[i]);
    const Eigen::Matrix2d aligned_to = bearing_covariance(camera_, patch.bearing, aligned_px);
    const Eigen::Matrix2d claimed = scale * scale * patch.covariance;
    match.bearing_covariance = aligned_to + claimed;
    if (corner_of[i] != nullptr) add_own_depth(*corner_of[i], config_.max_relative_sigma, match);
    aligned.push_back(match);
  }
  return aligned;
}

std::vector<KeyframeMatcher::Search> KeyframeMatcher::look_for(
    std::uint64_t own_keyframe, const PeerKeyframe& other,
    const std::vector<PeerLandmark>& landmarks, const Eigen::Isometry3d& T_other_own,
    std::vector<Search> searches) const {
  constexpr double kNearly_px = 1.0;  // well within the reach of a search
  const auto image = std::find_if(images_.rbegin(), images_.rend(),
                                  [&](const auto& known) { return known.first == own_keyframe; });
  searches.resize(landmarks.size());
  if (image == images_.rend()) return searches;
  const Eigen::Vector3d up = other.pose.T_world_cam.linear().row(2);
  const Eigen::Isometry3d T_own_other = T_other_own.inverse();
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    const PeerLandmark& landmark = landmarks[i];
    const Eigen::Vector3d p_own = T_own_other * position_of(landmark);
    const Search before = std::exchange(searches[i], {});
    if (landmark.patch == LandmarkPatch{} || !(p_own.z() > 0)) continue;
    const Eigen::Vector2d expected = p_own.hnormalized();
    if (before.expected &&
        (px_per_bearing(camera_, expected) * (expected - *before.expected)).norm() < kNearly_px) {
      searches[i] = before;
      continue;
    }
    const SeenLandmark seen{landmark.bearing, landmark.inverse_depth, &landmark.patch,
                            other.patch_spacing, up};
    searches[i] = {expected,
                   find_landmark_patch(image->second, camera_, seen, T_other_own, config_.patch)};
  }
  return searches;
}

}  // namespace covey
