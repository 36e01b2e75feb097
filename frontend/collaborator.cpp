// SPDX-License-Identifier: Apache-2.0
#include "frontend/collaborator.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "frontend/compact_place.h"

namespace covey {
namespace {

constexpr double kMaxCoordinate = 1e6;  // m

void check(const CollaboratorConfig& config, const Vocabulary& vocabulary, double focal_length_px) {
  const auto require = [](bool good, const char* what) {
    if (!good) throw std::runtime_error(std::string("collaborator: ") + what);
  };
  require(!config.agent.empty(), "agent must have a name");
  require(!vocabulary.words.empty(), "the vocabulary has no words");
  require(focal_length_px > 0, "the focal length must be positive (px)");
  require(config.keyframe.fallback_depth > 0, "keyframe.fallback_depth must be positive (m)");
  require(config.min_landmarks >= 1 && config.max_landmarks >= config.min_landmarks,
          "need 1 <= min_landmarks <= max_landmarks");
  require(config.verification.min_inliers >= 3 && config.verification.inlier_px > 0,
          "verification needs min_inliers >= 3 and inlier_px > 0");
  require(config.max_relative_sigma > 0 && config.matching_sigma_px >= 0,
          "need max_relative_sigma > 0 and matching_sigma_px >= 0");
}

double largest_sigma(const Eigen::Matrix3d& covariance) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen;
  eigen.computeDirect(covariance, Eigen::EigenvaluesOnly);
  return std::sqrt(eigen.eigenvalues().maxCoeff());
}

bool is_valid(const LandmarkEstimate& landmark) {
  const Eigen::Matrix3d& P = landmark.covariance;
  if (!landmark.p_world.allFinite() || !P.allFinite()) return false;
  if (landmark.p_world.cwiseAbs().maxCoeff() > kMaxCoordinate) return false;
  if ((P - P.transpose()).cwiseAbs().maxCoeff() > 1e-6 * P.cwiseAbs().maxCoeff()) return false;
  return P.llt().info() == Eigen::Success;
}

bool is_certain(const LandmarkEstimate& landmark, const Eigen::Vector3d& p_world_cam,
                double max_relative_sigma) {
  return largest_sigma(landmark.covariance) <=
         max_relative_sigma * (landmark.p_world - p_world_cam).norm();
}

bool is_well_formed(const PeerKeyframe& message, int max_landmarks) {
  if (message.sender.empty()) return false;
  if (message.landmarks.size() > static_cast<std::size_t>(max_landmarks)) return false;
  return std::all_of(message.landmarks.begin(), message.landmarks.end(),
                     [](const PeerLandmark& landmark) {
                       return landmark.bearing.allFinite() && is_valid(landmark.estimate);
                     });
}

// The landmarks worth matching, each id once: two descriptors of one landmark would be two matches.
std::vector<PeerLandmark> usable_landmarks(const PeerKeyframe& message,
                                           const Eigen::Vector3d& p_world_cam,
                                           double max_relative_sigma) {
  std::vector<PeerLandmark> usable;
  std::set<std::uint64_t> seen;
  for (const PeerLandmark& landmark : message.landmarks) {
    if (!is_certain(landmark.estimate, p_world_cam, max_relative_sigma)) continue;
    if (seen.insert(landmark.estimate.landmark_id).second) usable.push_back(landmark);
  }
  return usable;
}

template <typename Features>
std::vector<BinaryDescriptor> descriptors_of(const Features& features) {
  std::vector<BinaryDescriptor> descriptors;
  descriptors.reserve(features.size());
  for (const auto& feature : features) descriptors.push_back(feature.descriptor);
  return descriptors;
}

std::vector<OwnFeature> features_of(const Keyframe& own) {
  std::vector<OwnFeature> features;
  features.reserve(own.features.size());
  for (const KeyframeFeature& feature : own.features) {
    features.push_back({feature.bearing, feature.descriptor});
  }
  return features;
}

std::vector<PeerPoint> points_of(const std::vector<PeerLandmark>& peer) {
  std::vector<PeerPoint> points;
  points.reserve(peer.size());
  for (const PeerLandmark& landmark : peer) {
    points.push_back({landmark.estimate.p_world, landmark.descriptor});
  }
  return points;
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
      break;
  }
  return "offset between the worlds too large";
}

Collaborator::Collaborator(const CollaboratorConfig& config, const Vocabulary& vocabulary,
                           double focal_length_px)
    : config_(config),
      vocabulary_(vocabulary),
      vocabulary_hash_(vocabulary_hash(vocabulary, config.place_mode)),
      place_threshold_(config.place_threshold > 0 ? config.place_threshold
                                                  : default_threshold(config.place_mode)),
      focal_length_px_(focal_length_px),
      database_(config.database),
      limiter_(config.limiter) {
  check(config, vocabulary, focal_length_px);
}

bool Collaborator::wants_keyframe(TimeNs stamp_ns, const Eigen::Isometry3d& T_world_cam,
                                  const std::vector<LandmarkEstimate>& landmarks) {
  now_ns_ = stamp_ns;
  const Keyframe* last = database_.last();
  return !last || is_keyframe(config_.keyframe, *last, stamp_ns, T_world_cam,
                              depth_of(T_world_cam, landmarks));
}

PlaceAdvert Collaborator::add_keyframe(const TrackedFrame& described,
                                       const Eigen::Isometry3d& T_world_cam,
                                       const std::vector<LandmarkEstimate>& landmarks) {
  Keyframe keyframe;
  keyframe.id = next_keyframe_id_++;
  keyframe.stamp_ns = described.stamp_ns;
  keyframe.T_world_cam = T_world_cam;
  keyframe.mean_depth = depth_of(T_world_cam, landmarks);
  for (const TrackedFeature& feature : described.features) {
    if (!feature.described) continue;
    keyframe.features.push_back({feature.track_id, feature.bearing, feature.descriptor});
  }
  keyframe.place =
      describe_place(vocabulary_, config_.place_mode, descriptors_of(keyframe.features));
  const PlaceAdvert advert{config_.agent, keyframe.id, keyframe.stamp_ns, vocabulary_hash_,
                           keyframe.place};
  database_.add(std::move(keyframe));
  database_.update_landmarks(landmarks);
  ++report_.keyframes;
  return advert;
}

void Collaborator::update_landmarks(const std::vector<LandmarkEstimate>& landmarks) {
  database_.update_landmarks(landmarks);
}

double Collaborator::depth_of(const Eigen::Isometry3d& T_world_cam,
                              const std::vector<LandmarkEstimate>& landmarks) const {
  return mean_depth(T_world_cam, landmarks, config_.keyframe.max_relative_sigma)
      .value_or(config_.keyframe.fallback_depth);
}

std::optional<PeerKeyframe> Collaborator::answer(const PlaceAdvert& advert) {
  ++report_.adverts_received;
  if (int* counter = refusal(advert)) {
    ++*counter;
    return std::nullopt;
  }
  std::optional<PeerKeyframe> answer = best_answer(advert);
  if (!answer) {
    ++report_.advert_unknown_place;
    return std::nullopt;
  }
  if (!limiter_.allows(advert.sender, answer->keyframe_id, now_ns_)) {
    ++report_.advert_too_soon;
    return std::nullopt;
  }
  limiter_.sent(advert.sender, answer->keyframe_id, now_ns_);
  ++report_.answered;
  return answer;
}

int* Collaborator::refusal(const PlaceAdvert& advert) {
  if (advert.sender == config_.agent) return &report_.advert_own;
  if (advert.sender.empty()) return &report_.advert_malformed;
  if (advert.vocabulary_hash != vocabulary_hash_) return &report_.advert_other_vocabulary;
  if (!is_place_size(vocabulary_, config_.place_mode, advert.descriptor.size())) {
    return &report_.advert_malformed;
  }
  return limiter_.allows(advert.sender, now_ns_) ? nullptr : &report_.advert_too_soon;
}

std::optional<PeerKeyframe> Collaborator::best_answer(const PlaceAdvert& advert) const {
  std::optional<PeerKeyframe> best;
  double best_score = place_threshold_;
  for (const RankedKeyframe& candidate : similar_keyframes(advert)) {
    std::vector<PeerLandmark> landmarks = sendable_landmarks(*candidate.keyframe);
    if (landmarks.size() < static_cast<std::size_t>(config_.min_landmarks)) continue;
    const double score = landmark_score(advert, candidate, landmarks);
    if (score < best_score) continue;
    best_score = score;
    best = PeerKeyframe{config_.agent,
                        advert.sender,
                        advert.keyframe_id,
                        candidate.keyframe->id,
                        candidate.keyframe->stamp_ns,
                        std::move(landmarks)};
  }
  return best;
}

std::vector<Collaborator::RankedKeyframe> Collaborator::similar_keyframes(
    const PlaceAdvert& advert) const {
  constexpr std::size_t kCandidates = 5;
  std::vector<RankedKeyframe> similar;
  for (const Keyframe& keyframe : database_.keyframes()) {
    const double score = place_score(config_.place_mode, advert.descriptor, keyframe.place);
    if (score >= place_threshold_) similar.push_back({&keyframe, score});
  }
  std::stable_sort(
      similar.begin(), similar.end(),
      [](const RankedKeyframe& a, const RankedKeyframe& b) { return a.score > b.score; });
  if (similar.size() > kCandidates) similar.resize(kCandidates);
  return similar;
}

// Corners without an estimate are of no use to the peer: where corners are compared one by one,
// only those that would be sent count.
double Collaborator::landmark_score(const PlaceAdvert& advert, const RankedKeyframe& candidate,
                                    const std::vector<PeerLandmark>& landmarks) const {
  if (config_.place_mode != PlaceMode::kCompact) return candidate.score;
  return common_share(advert.descriptor, describe_compact(descriptors_of(landmarks)));
}

std::vector<PeerLandmark> Collaborator::sendable_landmarks(const Keyframe& keyframe) const {
  std::vector<PeerLandmark> landmarks;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (landmarks.size() >= static_cast<std::size_t>(config_.max_landmarks)) break;
    const LandmarkEstimate* estimate = database_.landmark(feature.track_id);
    if (!estimate || !is_valid(*estimate)) continue;
    if (!is_certain(*estimate, keyframe.T_world_cam.translation(), config_.max_relative_sigma)) {
      continue;
    }
    landmarks.push_back({feature.descriptor, feature.bearing, *estimate});
  }
  return landmarks;
}

std::variant<PeerMatches, NoMatch> Collaborator::match(const PeerKeyframe& message) {
  ++report_.keyframes_received;
  std::variant<PeerMatches, NoMatch> result = find_matches(message);
  if (const auto* none = std::get_if<NoMatch>(&result)) {
    ++report_.no_match[static_cast<std::size_t>(none->reason)];
  } else {
    ++report_.matched;
    report_.landmark_pairs += static_cast<int>(std::get<PeerMatches>(result).matches.size());
  }
  return result;
}

std::variant<PeerMatches, NoMatch> Collaborator::find_matches(const PeerKeyframe& message) const {
  if (message.receiver != config_.agent || message.sender == config_.agent) {
    return NoMatch{NoMatchReason::kNotForUs};
  }
  if (!is_well_formed(message, config_.max_landmarks)) return NoMatch{NoMatchReason::kMalformed};
  const Keyframe* own = database_.find(message.request_keyframe_id);
  if (!own) return NoMatch{NoMatchReason::kUnknownRequest};

  const Eigen::Vector3d p_world_cam = own->T_world_cam.translation();
  const std::vector<PeerLandmark> peer =
      usable_landmarks(message, p_world_cam, config_.max_relative_sigma);
  const VerificationResult result = find_offset(*own, peer);
  if (!result.verified) return NoMatch{to_reason(result.failure)};
  const std::vector<IndexPair> pairs =
      match_guided(own->T_world_cam, result.verified->offset, features_of(*own), points_of(peer),
                   focal_length_px_, config_.guided);
  if (pairs.size() < static_cast<std::size_t>(config_.min_matches)) {
    return NoMatch{NoMatchReason::kTooFewMatches};
  }
  PeerMatches matches{message.sender, own->stamp_ns, {}};
  for (const IndexPair& pair : pairs) {
    const LandmarkEstimate& estimate = peer[pair.peer].estimate;
    const double distance = (estimate.p_world - p_world_cam).norm();  // m
    matches.matches.push_back({own->features[pair.own].track_id, estimate,
                               config_.matching_sigma_px / focal_length_px_ * distance});
  }
  return matches;
}

VerificationResult Collaborator::find_offset(const Keyframe& own,
                                             const std::vector<PeerLandmark>& peer) const {
  std::vector<Correspondence> correspondences;
  for (const IndexPair& pair :
       match_descriptors(descriptors_of(own.features), descriptors_of(peer), config_.matching)) {
    correspondences.push_back({peer[pair.peer].estimate.p_world, own.features[pair.own].bearing});
  }
  return verify(own.T_world_cam, correspondences, focal_length_px_, config_.verification);
}

}  // namespace covey
