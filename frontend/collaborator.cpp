// SPDX-License-Identifier: Apache-2.0
#include "frontend/collaborator.h"

#include <algorithm>
#include <iterator>
#include <unordered_map>
#include <utility>

#include "frontend/message_checks.h"
#include "frontend/nearest_views.h"

namespace covey {
namespace {

// With what this drone has seen: it was an answer to it, and well formed.
bool was_compared(NoMatchReason reason) {
  return reason != NoMatchReason::kNotForUs && reason != NoMatchReason::kMalformed &&
         reason != NoMatchReason::kUnknownRequest;
}

std::vector<PeerLandmark> to_peer_landmarks(const std::vector<KeyframeFeature>& features) {
  std::vector<PeerLandmark> landmarks;
  landmarks.reserve(features.size());
  for (const KeyframeFeature& feature : features) {
    landmarks.push_back({shortened(feature.descriptor), feature.bearing, feature.inverse_depth,
                         feature.inverse_depth_sigma, feature.patch});
  }
  return landmarks;
}

// What is still tracked has been used all along: it says nothing new of the drift since then.
std::vector<KeyframeFeature> lost_since(const std::vector<KeyframeFeature>& landmarks,
                                        const Keyframe& newest) {
  std::vector<KeyframeFeature> lost;
  const auto earlier = [](const KeyframeFeature& a, const KeyframeFeature& b) {
    return a.track_id < b.track_id;
  };
  std::set_difference(landmarks.begin(), landmarks.end(), newest.features.begin(),
                      newest.features.end(), std::back_inserter(lost), earlier);
  return lost;
}

}  // namespace

Collaborator::Collaborator(const CollaboratorConfig& config, const Vocabulary& vocabulary,
                           const CameraIntrinsics& camera)
    : config_(for_exchange(config)),
      vocabulary_(vocabulary),
      vocabulary_hash_(vocabulary_hash(vocabulary, config_.place_mode)),
      answer_rules_(answer_rules(config_)),
      camera_(camera),
      patch_spacing_(config.matching.patch.spacing_px / mean_focal_length_px(camera)),
      database_(config.database),
      peer_memory_(config.remembered),
      matcher_(config.matching, camera),
      limiter_(config_.limiter),
      questions_(question_rules(config_)) {
  require_workable(config, vocabulary, camera);
  matcher_.know_world(config.agent, Eigen::Isometry3d::Identity());
}

void Collaborator::set_intrinsics(const CameraIntrinsics& camera) {
  camera_ = camera;
  matcher_.set_intrinsics(camera);
}

void Collaborator::know_world(const std::string& peer, const Eigen::Isometry3d& T_own_peer) {
  matcher_.know_world(peer, T_own_peer);
  questions_.forget_stranger(peer);
}

void Collaborator::place_anew(const std::string& peer) {
  const std::optional<Eigen::Isometry3d> world = matcher_.world_of(peer);
  if (world) peer_memory_.place_anew(peer, *world);
}

void Collaborator::suppose_world(const std::string& peer, const Eigen::Isometry3d& T_own_peer) {
  matcher_.suppose_world(peer, T_own_peer);
}

bool Collaborator::wants_keyframe(TimeNs stamp_ns, const Eigen::Isometry3d& T_world_cam) const {
  const Keyframe* last = database_.last();
  return !last ||
         is_keyframe(config_.keyframe, last->pose, stamp_ns, T_world_cam, last->mean_depth);
}

PlaceAdvert Collaborator::add_keyframe(const TrackedFrame& described, const ImagePyramid& image,
                                       const Eigen::Isometry3d& T_world_cam,
                                       const Matrix6d& covariance,
                                       const std::vector<TrackDepth>& depths) {
  database_.add(make_keyframe(described, image, T_world_cam, covariance, depths));
  ++report_.keyframes;
  return advert_of(*database_.last());
}

PlaceAdvert Collaborator::add_frame(const TrackedFrame& described, const ImagePyramid& image,
                                    const Eigen::Isometry3d& T_world_cam,
                                    const Matrix6d& covariance,
                                    const std::vector<TrackDepth>& depths) {
  recent_frames_.push_back(make_keyframe(described, image, T_world_cam, covariance, depths));
  if (recent_frames_.size() > config_.recent_frames) recent_frames_.pop_front();
  return advert_of(recent_frames_.back());
}

Keyframe Collaborator::make_keyframe(const TrackedFrame& described, const ImagePyramid& image,
                                     const Eigen::Isometry3d& T_world_cam,
                                     const Matrix6d& covariance,
                                     const std::vector<TrackDepth>& depths) {
  if (next_keyframe_id_ == 1) matcher_.note_start(T_world_cam.translation());
  Keyframe keyframe;
  keyframe.pose = {next_keyframe_id_++, described.stamp_ns, T_world_cam, covariance};
  keyframe.before = measured_since(database_.keyframes(), keyframe.pose, config_.depth_memory_s);
  keyframe.mean_depth = mean_depth(depths, config_.keyframe.max_relative_sigma)
                            .value_or(config_.keyframe.fallback_depth);
  std::unordered_map<std::uint64_t, const TrackDepth*> depth_of;
  for (const TrackDepth& depth : depths) depth_of[depth.track_id] = &depth;
  if (!image.levels.empty()) matcher_.keep_image(keyframe.pose.keyframe_id, image);
  for (const TrackedFeature& feature : described.features) {
    if (!feature.described) continue;
    KeyframeFeature stored{feature.track_id, feature.bearing, feature.descriptor, 0, 0, {}};
    if (!image.levels.empty()) {
      stored.patch = cut_landmark_patch(image.levels[0], camera_, feature.bearing, patch_spacing_)
                         .value_or(LandmarkPatch{});
    }
    if (const auto known = depth_of.find(feature.track_id); known != depth_of.end()) {
      stored.inverse_depth = known->second->inverse_depth;
      stored.inverse_depth_sigma = known->second->inverse_depth_sigma;
    }
    keyframe.features.push_back(stored);
  }
  keyframe.place =
      describe_place(vocabulary_, config_.place_mode, descriptors_of(keyframe.features));
  return keyframe;
}

const Keyframe* Collaborator::newest_image() const {
  const Keyframe* keyframe = database_.last();
  if (recent_frames_.empty()) return keyframe;
  const Keyframe& frame = recent_frames_.back();
  return keyframe && keyframe->pose.keyframe_id > frame.pose.keyframe_id ? keyframe : &frame;
}

const Keyframe* Collaborator::find_image(std::uint64_t keyframe_id) const {
  const auto frame =
      std::find_if(recent_frames_.begin(), recent_frames_.end(),
                   [&](const Keyframe& recent) { return recent.pose.keyframe_id == keyframe_id; });
  return frame == recent_frames_.end() ? database_.find(keyframe_id) : &*frame;
}

PlaceAdvert Collaborator::advert_of(const Keyframe& keyframe) const {
  CameraView view = view_of(keyframe);
  view.sigma = view_sigma(keyframe);
  return {config_.agent, keyframe.pose.keyframe_id, keyframe.pose.stamp_ns, vocabulary_hash_, view,
          keyframe.place};
}

bool Collaborator::wants_to_ask() { return questions_.asks_about(*database_.last(), now_ns_); }

PlaceAdvert Collaborator::question(PlaceAdvert advert) {
  if (questions_.next_is_brief(advert.stamp_ns, now_ns_)) advert.descriptor.clear();
  return advert;
}

std::optional<PlaceAdvert> Collaborator::repeated_question() {
  if (!questions_.repeats(now_ns_)) return std::nullopt;
  // The number of an older keyframe would look like another flight's.
  return advert_of(*database_.last());
}

std::optional<PeerKeyframe> Collaborator::announcement() const {
  const Keyframe* newest = newest_image();
  if (!newest) return std::nullopt;
  const std::vector<KeyframeFeature> landmarks =
      landmarks_of(*newest, config_.matching.max_relative_sigma);
  if (landmarks.size() < static_cast<std::size_t>(config_.min_landmarks)) return std::nullopt;
  return told(*newest, landmarks);
}

PeerKeyframe Collaborator::as_seen(const Keyframe& keyframe,
                                   const std::vector<KeyframeFeature>& landmarks) const {
  return {config_.agent,
          "",
          0,
          keyframe.pose,
          keyframe.before,
          patch_spacing_,
          true,
          to_peer_landmarks(landmarks),
          {}};
}

PeerKeyframe Collaborator::told(const Keyframe& keyframe,
                                const std::vector<KeyframeFeature>& landmarks) const {
  PeerKeyframe message = as_seen(keyframe, landmarks);
  if (config_.exchange != ExchangeMode::kCompact && !config_.pictures_always) {
    message.patch_spacing = 0;
    for (PeerLandmark& landmark : message.landmarks) landmark.patch = {};
  }
  return message;
}

std::optional<PeerKeyframe> Collaborator::answer(const PlaceAdvert& advert) {
  ++report_.adverts_received;
  if (const Counter counter = mistake_in(advert)) {
    ++(report_.*counter);
    return std::nullopt;
  }
  if (has_started_anew(advert)) peer_memory_.forget(advert.sender);
  matcher_.note_keyframe(advert.sender, advert.keyframe_id);
  if (!matcher_.world_of(advert.sender)) questions_.note_stranger(advert.sender, now_ns_);
  const std::optional<CameraView> asked_from = view_of_asker(advert);
  if (const Counter counter = refusal(advert, asked_from)) {
    ++(report_.*counter);
    return std::nullopt;
  }
  const int most = limiter_.max_landmarks(advert.sender, now_ns_);
  const std::optional<ChosenAnswer> chosen =
      choose_answer(answer_rules_, not_just_sent_to(advert.sender),
                    {&advert, asked_from, static_cast<std::size_t>(most)}, tolerance_, camera_);
  if (!chosen) {
    ++report_.advert_unknown_place;
    return std::nullopt;
  }
  // Who cannot be told from where it asks is answered as often as it may be: it is still looking.
  const bool awaits_word = config_.tell_found && asked_from.has_value();
  limiter_.sent(advert.sender, chosen->keyframe->pose.keyframe_id, now_ns_, awaits_word);
  ++report_.answered;
  PeerKeyframe answer = told(*chosen->keyframe, chosen->landmarks);
  answer.described = !is_brief(advert);
  answer.receiver = advert.sender;
  answer.request_keyframe_id = advert.keyframe_id;
  return answer;
}

bool Collaborator::has_started_anew(const PlaceAdvert& advert) const {
  return !mistake_in(advert) && matcher_.has_started_anew(advert.sender, advert.keyframe_id);
}

Collaborator::Counter Collaborator::mistake_in(const PlaceAdvert& advert) const {
  using Report = CollaboratorReport;
  if (advert.sender == config_.agent) return &Report::advert_own;
  if (advert.sender.empty() || !is_plausible(advert.view)) return &Report::advert_malformed;
  if (advert.vocabulary_hash != vocabulary_hash_) return &Report::advert_other_vocabulary;
  if (!is_brief(advert) &&
      !is_place_size(vocabulary_, config_.place_mode, advert.descriptor.size())) {
    return &Report::advert_malformed;
  }
  return nullptr;
}

// In the own world, as far as it is known where the asker's lies. Its sigma is that of both drones'
// odometry since the start: drift that has been found since is in the alignment, as is how wrong
// the starts were, once it is known.
std::optional<CameraView> Collaborator::view_of_asker(const PlaceAdvert& advert) const {
  const std::optional<Eigen::Isometry3d> world = matcher_.world_of(advert.sender);
  const Keyframe* newest = database_.last();
  if (!world || !newest || config_.exchange != ExchangeMode::kCompact) return std::nullopt;
  CameraView view = advert.view;
  view.T_world_cam = *world * view.T_world_cam;
  const double start_sigma = matcher_.start_sigma_at(advert.sender, view.T_world_cam.translation());
  view.sigma +=
      view_sigma(*newest) + start_sigma / view.mean_depth + matcher_.start_yaw_sigma(advert.sender);
  return view;
}

Collaborator::Counter Collaborator::refusal(const PlaceAdvert& advert,
                                            const std::optional<CameraView>& asked_from) const {
  if (is_brief(advert) && (!asked_from || !is_sure(*asked_from, tolerance_))) {
    return &CollaboratorReport::advert_unknown_asker;
  }
  return limiter_.allows(advert.sender, now_ns_) ? nullptr : &CollaboratorReport::advert_too_soon;
}

std::vector<const Keyframe*> Collaborator::not_just_sent_to(const std::string& peer) const {
  std::vector<const Keyframe*> keyframes;
  for (const Keyframe& keyframe : database_.keyframes()) {
    if (!limiter_.has_just_sent(peer, keyframe.pose.keyframe_id, now_ns_)) {
      keyframes.push_back(&keyframe);
    }
  }
  return keyframes;
}

const Keyframe* Collaborator::hear_found(const PeerKeyframe& message) {
  if (!message.found || message.receiver != config_.agent || !is_well_formed(message)) {
    return nullptr;
  }
  const std::uint64_t keyframe_id = message.found->keyframe_id;
  if (!limiter_.has_sent(message.sender, keyframe_id)) return nullptr;
  limiter_.found(message.sender);
  return database_.find(keyframe_id);
}

std::variant<KeyframeMatch, NoMatch> Collaborator::match(const PeerKeyframe& message) {
  ++report_.keyframes_received;
  std::variant<KeyframeMatch, NoMatch> result = find_matches(message);
  if (const auto* none = std::get_if<NoMatch>(&result)) {
    ++report_.no_match[static_cast<std::size_t>(none->reason)];
    if (was_compared(none->reason)) {
      questions_.note_answer(message.request_keyframe_id);
      if (!message.described) questions_.want_corners();
    }
    remember_for_later(message, none->reason);
  } else {
    const auto& match = std::get<KeyframeMatch>(result);
    questions_.note_answer(message.request_keyframe_id);
    peer_memory_.remember(message, match.own.T_world_cam * match.T_other_own.inverse());
    learn_tolerance(message, match);
    questions_.note_match(now_ns_);
    ++report_.matched;
    report_.landmark_pairs += static_cast<int>(match.matches.size());
  }
  return result;
}

std::variant<KeyframeMatch, NoMatch> Collaborator::find_matches(const PeerKeyframe& message) const {
  const bool for_all = message.receiver.empty() && config_.exchange == ExchangeMode::kNaive;
  if ((message.receiver != config_.agent && !for_all) || message.sender == config_.agent) {
    return NoMatch{NoMatchReason::kNotForUs};
  }
  if (!is_well_formed(message)) return NoMatch{NoMatchReason::kMalformed};
  const Keyframe* own = for_all ? newest_image() : find_image(message.request_keyframe_id);
  if (!own) return NoMatch{NoMatchReason::kUnknownRequest};

  return compare(*own, message);
}

std::variant<KeyframeMatch, NoMatch> Collaborator::compare(const Keyframe& own,
                                                           const PeerKeyframe& other) const {
  std::variant<KeyframeMatch, NoMatch> result = matcher_.match(own, other);
  const auto* match = std::get_if<KeyframeMatch>(&result);
  if (match && !matcher_.world_of(other.sender) && may_be_another_place(other, *match)) {
    return NoMatch{NoMatchReason::kTooFewFound};
  }
  return result;
}

// At these angles, rad.
std::vector<double> Collaborator::looked_for(const PeerKeyframe& other,
                                             const KeyframeMatch& match) const {
  std::vector<PeerLandmark> landmarks = landmarks_of(other, config_.matching.max_relative_sigma);
  const auto without_patch = std::remove_if(
      landmarks.begin(), landmarks.end(),
      [](const PeerLandmark& landmark) { return landmark.patch == LandmarkPatch{}; });
  landmarks.erase(without_patch, landmarks.end());
  return viewing_angles(positions_of(landmarks), match.T_other_own, camera_);
}

bool Collaborator::may_be_another_place(const PeerKeyframe& other,
                                        const KeyframeMatch& match) const {
  const double finds = tolerance_.expected_finds(looked_for(other, match));
  return static_cast<double>(match.aligned.size()) < config_.least_found_share * finds;
}

// From where it is sure what is looked at.
void Collaborator::learn_tolerance(const PeerKeyframe& other, const KeyframeMatch& match) {
  if (match.aligned.empty() || !matcher_.world_of(other.sender)) return;
  tolerance_.learn(looked_for(other, match), match.aligned.size());
}

// What is not found yet may be, when this drone has come nearer.
void Collaborator::remember_for_later(const PeerKeyframe& message, NoMatchReason reason) {
  const std::optional<Eigen::Isometry3d> world = matcher_.likely_world_of(message.sender);
  const bool looked_for =
      reason == NoMatchReason::kTooFewMatches || reason == NoMatchReason::kTooFewInliers;
  if (!world || !looked_for || message.landmarks.empty()) return;
  peer_memory_.remember(message, *world * message.pose.T_world_cam);
}

std::vector<KeyframeMatch> Collaborator::revisit() {
  std::vector<KeyframeMatch> matches;
  const Keyframe* newest = database_.last();
  if (newest == nullptr) return matches;
  const CameraView view = view_of(*newest);
  struct Candidate {
    const Keyframe* own = nullptr;
    const PeerKeyframe* peer = nullptr;
  };
  NearestViews<std::string, Candidate> nearest(config_.revisit_max_difference,
                                               config_.max_revisits);
  for (const Keyframe& old : database_.keyframes()) {
    if (&old == newest) break;
    if (seconds_between(old.pose.stamp_ns, newest->pose.stamp_ns) < config_.loop_min_age_s) break;
    nearest.consider(config_.agent, view_difference(view_of(old), view), {&old, nullptr});
  }
  for (const auto& [peer, peer_view] : peer_memory_.entries()) {
    nearest.consider(peer.sender, view_difference(peer_view, view), {nullptr, &peer});
  }
  const auto left_behind = [&](const Keyframe& old) {
    const auto landmarks = landmarks_of(old, config_.matching.max_relative_sigma);
    return as_seen(old, lost_since(landmarks, *newest));
  };
  for (const Candidate& candidate : nearest.take()) {
    std::optional<KeyframeMatch> match = candidate.peer
                                             ? recognise(*newest, *candidate.peer)
                                             : recognise(*newest, left_behind(*candidate.own));
    if (match) matches.push_back(std::move(*match));
  }
  return matches;
}

std::optional<KeyframeMatch> Collaborator::recognise(const Keyframe& newest,
                                                     const PeerKeyframe& old) {
  auto result = compare(newest, old);
  auto* match = std::get_if<KeyframeMatch>(&result);
  if (match == nullptr) return std::nullopt;
  learn_tolerance(old, *match);
  return std::move(*match);
}

}  // namespace covey
