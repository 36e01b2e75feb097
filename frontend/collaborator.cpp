// SPDX-License-Identifier: Apache-2.0
#include "frontend/collaborator.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <unordered_map>
#include <utility>

#include "frontend/compact_place.h"
#include "frontend/nearest_views.h"

namespace covey {
namespace {

constexpr double kMaxCoordinate = 1e6;     // m
constexpr std::size_t kMaxAccepted = 256;  // landmarks of a message

void check(const CollaboratorConfig& config, const Vocabulary& vocabulary,
           const CameraIntrinsics& camera) {
  const auto require = [](bool good, const char* what) {
    if (!good) throw std::runtime_error(std::string("collaborator: ") + what);
  };
  require(!config.agent.empty(), "agent must have a name");
  require(!vocabulary.words.empty(), "the vocabulary has no words");
  require(mean_focal_length_px(camera) > 0, "the focal length must be positive (px)");
  require(config.keyframe.fallback_depth > 0, "keyframe.fallback_depth must be positive (m)");
  require(config.min_landmarks >= 1 && config.limiter.max_landmarks >= config.min_landmarks,
          "need 1 <= min_landmarks <= max_landmarks");
  require(
      config.matching.verification.min_inliers >= 3 && config.matching.verification.inlier_px > 0,
      "verification needs min_inliers >= 3 and inlier_px > 0");
  require(config.matching.max_relative_sigma > 0 && config.matching.sigma_px >= 0,
          "need matching.max_relative_sigma > 0 and matching.sigma_px >= 0");
}

// The paper's drones know places by its VLAD and answer whatever they know.
CollaboratorConfig for_exchange(CollaboratorConfig config) {
  // The paper does not tell its threshold. As high as leaves answers in the yard: they are large.
  constexpr double kThreshold = 0.28;
  if (config.exchange == ExchangeMode::kCompact) return config;
  config.place_mode = PlaceMode::kPaper;
  if (config.place_threshold == 0) config.place_threshold = kThreshold;
  config.limiter.answer_interval_s = 0;
  config.limiter.resend_interval_s = 0;
  config.limiter.landmarks_per_s = 0;
  config.limiter.max_landmarks = static_cast<int>(kMaxAccepted);
  config.corners_interval_s = 0;
  return config;
}

bool is_finite(const FoundKeyframe& found) {
  return found.T_keyframe_cam.matrix().allFinite() && std::isfinite(found.log_depth_ratio) &&
         found.covariance.allFinite();
}

bool is_well_formed(const PeerKeyframe& message) {
  if (message.sender.empty() || message.landmarks.size() > kMaxAccepted) return false;
  if (!std::isfinite(message.patch_spacing)) return false;
  if (message.found && !is_finite(*message.found)) return false;
  for (const KeyframePose& pose : {message.pose, message.before}) {
    if (!pose.T_world_cam.matrix().allFinite() || !pose.covariance.allFinite() ||
        pose.T_world_cam.translation().cwiseAbs().maxCoeff() > kMaxCoordinate) {
      return false;
    }
  }
  return std::all_of(
      message.landmarks.begin(), message.landmarks.end(), [](const PeerLandmark& landmark) {
        return landmark.bearing.allFinite() && std::isfinite(landmark.inverse_depth) &&
               std::isfinite(landmark.inverse_depth_sigma);
      });
}

std::vector<BinaryDescriptor> descriptors_of(const std::vector<KeyframeFeature>& features) {
  std::vector<BinaryDescriptor> descriptors;
  descriptors.reserve(features.size());
  for (const KeyframeFeature& feature : features) descriptors.push_back(feature.descriptor);
  return descriptors;
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

// In the frame of the camera that has seen it.
template <typename Landmark>
Eigen::Vector3d position_of(const Landmark& landmark) {
  return landmark.bearing.homogeneous() / landmark.inverse_depth;
}

template <typename Landmarks>
std::vector<Eigen::Vector3d> positions_of(const Landmarks& landmarks) {
  std::vector<Eigen::Vector3d> positions;
  positions.reserve(landmarks.size());
  for (const auto& landmark : landmarks) positions.push_back(position_of(landmark));
  return positions;
}

constexpr std::size_t kCandidates = 5;  // for an answer, of which the best is taken

constexpr double kSigmas = 3;  // of where a question was asked from, that drift may have made

// Between a keyframe's view and the one that was asked from, at least: drift may have made the
// rest.
double sure_difference(const Keyframe& keyframe, const CameraView& asked_from) {
  return view_difference(view_of(keyframe), asked_from) - kSigmas * asked_from.sigma;
}

// The same landmarks tell a relative pose the better the nearer the views are, until a difference
// of about kLeastDifference.
double answer_worth(double score, const Keyframe& keyframe,
                    const std::optional<CameraView>& asked_from) {
  constexpr double kLeastDifference = 0.3;
  if (!asked_from) return score;
  return score / (kLeastDifference + view_difference(view_of(keyframe), *asked_from));
}

bool is_brief(const PlaceAdvert& advert) { return advert.descriptor.empty(); }

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

const char* to_string(ExchangeMode exchange) {
  switch (exchange) {
    case ExchangeMode::kCompact:
      return "compact";
    case ExchangeMode::kPaper:
      return "paper";
    case ExchangeMode::kNaive:
      break;
  }
  return "naive";
}

std::optional<ExchangeMode> exchange_from_name(const std::string& name) {
  for (const ExchangeMode mode :
       {ExchangeMode::kCompact, ExchangeMode::kPaper, ExchangeMode::kNaive}) {
    if (name == to_string(mode)) return mode;
  }
  return std::nullopt;
}

Collaborator::Collaborator(const CollaboratorConfig& config, const Vocabulary& vocabulary,
                           const CameraIntrinsics& camera)
    : config_(for_exchange(config)),
      vocabulary_(vocabulary),
      vocabulary_hash_(vocabulary_hash(vocabulary, config_.place_mode)),
      place_threshold_(config_.place_threshold > 0 ? config_.place_threshold
                                                   : default_threshold(config_.place_mode)),
      camera_(camera),
      patch_spacing_(config.matching.patch.spacing_px / mean_focal_length_px(camera)),
      database_(config.database),
      matcher_(config.matching, camera),
      limiter_(config_.limiter) {
  check(config, vocabulary, camera);
  matcher_.know_world(config.agent, Eigen::Isometry3d::Identity());
}

void Collaborator::know_world(const std::string& peer, const Eigen::Isometry3d& T_own_peer) {
  matcher_.know_world(peer, T_own_peer);
  strangers_.erase(peer);
}

bool Collaborator::wants_keyframe(TimeNs stamp_ns, const Eigen::Isometry3d& T_world_cam) {
  now_ns_ = stamp_ns;
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

bool Collaborator::wants_to_ask() {
  const Keyframe& newest = *database_.last();
  if (config_.exchange == ExchangeMode::kCompact &&
      !is_worth_asking(config_.question, last_asked_, newest.pose, newest.mean_depth)) {
    return false;
  }
  last_asked_ = newest.pose;
  return true;
}

PlaceAdvert Collaborator::question(PlaceAdvert advert) {
  const double interval_s = config_.corners_interval_s / (strangers_.empty() ? 1 : 3);
  if (may_ask_briefly(interval_s, corners_told_ns_, advert.stamp_ns)) {
    advert.descriptor.clear();
  } else {
    corners_told_ns_ = advert.stamp_ns;
  }
  return advert;
}

PlaceAdvert Collaborator::add_frame(const TrackedFrame& described, const ImagePyramid& image,
                                    const Eigen::Isometry3d& T_world_cam,
                                    const Matrix6d& covariance,
                                    const std::vector<TrackDepth>& depths) {
  recent_frames_.push_back(make_keyframe(described, image, T_world_cam, covariance, depths));
  if (recent_frames_.size() > config_.recent_frames) recent_frames_.pop_front();
  return advert_of(recent_frames_.back());
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

std::optional<PeerKeyframe> Collaborator::announcement() const {
  const Keyframe* newest = newest_image();
  if (!newest) return std::nullopt;
  const std::vector<KeyframeFeature> landmarks = landmarks_of(*newest);
  if (landmarks.size() < static_cast<std::size_t>(config_.min_landmarks)) return std::nullopt;
  return told(*newest, landmarks);
}

PeerKeyframe Collaborator::told(const Keyframe& keyframe,
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

PlaceAdvert Collaborator::advert_of(const Keyframe& keyframe) const {
  CameraView view = view_of(keyframe);
  view.sigma = view_sigma(keyframe);
  return {config_.agent, keyframe.pose.keyframe_id, keyframe.pose.stamp_ns, vocabulary_hash_, view,
          keyframe.place};
}

Keyframe Collaborator::make_keyframe(const TrackedFrame& described, const ImagePyramid& image,
                                     const Eigen::Isometry3d& T_world_cam,
                                     const Matrix6d& covariance,
                                     const std::vector<TrackDepth>& depths) {
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
    if (seconds_between(old.pose.stamp_ns, newest->pose.stamp_ns) < config_.loop_min_age_s) break;
    nearest.consider(config_.agent, view_difference(view_of(old), view), {&old, nullptr});
  }
  for (const auto& [peer, peer_view] : remembered_) {
    nearest.consider(peer.sender, view_difference(peer_view, view), {nullptr, &peer});
  }
  for (const Candidate& candidate : nearest.take()) {
    std::optional<KeyframeMatch> match =
        candidate.peer
            ? recognise(*newest, *candidate.peer)
            : recognise(*newest,
                        told(*candidate.own, lost_since(landmarks_of(*candidate.own), *newest)));
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
  ++report_.revisits;
  return std::move(*match);
}

void Collaborator::forget(const std::string& peer) {
  remembered_.erase(
      std::remove_if(remembered_.begin(), remembered_.end(),
                     [&](const Remembered& seen) { return seen.keyframe.sender == peer; }),
      remembered_.end());
}

void Collaborator::remember(const PeerKeyframe& message, const KeyframeMatch& match) {
  bool known = false, starts_anew = false;
  for (const Remembered& seen : remembered_) {
    if (seen.keyframe.sender != message.sender) continue;
    known |= seen.keyframe.pose.keyframe_id == message.pose.keyframe_id;
    starts_anew |= !are_of_one_flight(seen.keyframe.pose, message.pose);
  }
  if (starts_anew) {
    forget(message.sender);
  } else if (known) {
    return;
  }
  const std::vector<PeerLandmark>& landmarks = message.landmarks;
  double depths = 0;
  for (const PeerLandmark& landmark : landmarks) depths += 1 / landmark.inverse_depth;
  const CameraView view{match.own.T_world_cam * match.T_other_own.inverse(),
                        depths / static_cast<double>(landmarks.size())};
  if (config_.remembered == 0) return;
  if (remembered_.size() >= config_.remembered) remembered_.pop_front();
  remembered_.push_back({message, view});
}

std::optional<PeerKeyframe> Collaborator::answer(const PlaceAdvert& advert) {
  ++report_.adverts_received;
  if (has_started_anew(advert)) forget(advert.sender);
  matcher_.note_keyframe(advert.sender, advert.keyframe_id);
  note_stranger(advert.sender);
  const std::optional<CameraView> asked_from = view_of_asker(advert);
  if (int* counter = refusal(advert, asked_from)) {
    ++*counter;
    return std::nullopt;
  }
  std::optional<PeerKeyframe> answer = best_answer(advert, asked_from);
  if (!answer) {
    ++report_.advert_unknown_place;
    return std::nullopt;
  }
  limiter_.sent(advert.sender, answer->pose.keyframe_id, now_ns_);
  ++report_.answered;
  return answer;
}

void Collaborator::note_stranger(const std::string& sender) {
  if (sender == config_.agent || matcher_.world_of(sender)) return;
  if (strangers_.size() < config_.limiter.max_peers) strangers_.insert(sender);
}

const Keyframe* Collaborator::answered_with(const PeerKeyframe& message) const {
  if (!message.found || message.receiver != config_.agent || !is_well_formed(message)) {
    return nullptr;
  }
  const std::uint64_t keyframe_id = message.found->keyframe_id;
  return limiter_.has_sent(message.sender, keyframe_id) ? database_.find(keyframe_id) : nullptr;
}

bool Collaborator::has_started_anew(const PlaceAdvert& advert) const {
  return matcher_.has_started_anew(advert.sender, advert.keyframe_id);
}

int* Collaborator::refusal(const PlaceAdvert& advert, const std::optional<CameraView>& asked_from) {
  if (advert.sender == config_.agent) return &report_.advert_own;
  if (advert.sender.empty()) return &report_.advert_malformed;
  if (advert.vocabulary_hash != vocabulary_hash_) return &report_.advert_other_vocabulary;
  if (is_brief(advert)) {
    if (!asked_from || !is_sure(*asked_from)) return &report_.advert_unknown_asker;
  } else if (!is_place_size(vocabulary_, config_.place_mode, advert.descriptor.size())) {
    return &report_.advert_malformed;
  }
  return limiter_.allows(advert.sender, now_ns_) ? nullptr : &report_.advert_too_soon;
}

std::optional<PeerKeyframe> Collaborator::best_answer(
    const PlaceAdvert& advert, const std::optional<CameraView>& asked_from) const {
  const Keyframe* best = nullptr;
  std::vector<KeyframeFeature> best_landmarks;
  double best_worth = 0;
  const auto most = static_cast<std::size_t>(limiter_.max_landmarks(advert.sender, now_ns_));
  for (const RankedKeyframe& candidate : is_brief(advert)
                                             ? nearest_keyframes(advert.sender, *asked_from)
                                             : similar_keyframes(advert, asked_from)) {
    std::vector<KeyframeFeature> landmarks = landmarks_of(*candidate.keyframe);
    if (landmarks.size() < static_cast<std::size_t>(config_.min_landmarks)) continue;
    if (asked_from && !would_be_found(landmarks, most, *candidate.keyframe, *asked_from)) continue;
    const double score = landmark_score(advert, candidate, landmarks);
    if (score < place_threshold_) continue;
    const double worth = answer_worth(score, *candidate.keyframe, asked_from);
    if (worth < best_worth) continue;
    best_worth = worth;
    best = candidate.keyframe;
    best_landmarks = std::move(landmarks);
  }
  if (best == nullptr) return std::nullopt;
  std::vector<KeyframeFeature> landmarks =
      is_brief(advert)
          ? in_sight(best_landmarks, best->pose.T_world_cam.inverse() * asked_from->T_world_cam)
          : most_useful(best_landmarks, advert);
  landmarks.resize(std::min(landmarks.size(), most));
  PeerKeyframe answer = told(*best, landmarks);
  answer.described = !is_brief(advert);
  answer.receiver = advert.sender;
  answer.request_keyframe_id = advert.keyframe_id;
  return answer;
}

// Chance finds grow with what is looked for, and half of all finds must agree: hence a share.
bool Collaborator::would_be_found(const std::vector<KeyframeFeature>& landmarks, std::size_t sent,
                                  const Keyframe& keyframe, const CameraView& asked_from) const {
  constexpr double kMinShare = 0.25;
  if (!is_sure(asked_from)) return true;  // nobody knows
  const std::vector<double> angles =
      viewing_angles(positions_of(landmarks),
                     keyframe.pose.T_world_cam.inverse() * asked_from.T_world_cam, camera_);
  const double finds = tolerance_.expected_finds(angles);
  const double sent_share =
      std::min(1.0, static_cast<double>(sent) / static_cast<double>(landmarks.size()));
  return sent_share * finds >= config_.matching.min_matches &&
         finds >= kMinShare * static_cast<double>(angles.size());
}

// Can it be told from there what will look alike?
bool Collaborator::is_sure(const CameraView& view) const {
  return kSigmas * view.sigma <= tolerance_.tolerance();
}

// From where it is sure what is looked at.
void Collaborator::learn_tolerance(const PeerKeyframe& other, const KeyframeMatch& match) {
  if (match.aligned.empty() || !matcher_.world_of(other.sender)) return;
  tolerance_.learn(viewing_angles(positions_of(other.landmarks), match.T_other_own, camera_),
                   match.aligned.size());
}

bool Collaborator::may_be_another_place(const PeerKeyframe& other,
                                        const KeyframeMatch& match) const {
  std::vector<PeerLandmark> with_patch;
  std::copy_if(other.landmarks.begin(), other.landmarks.end(), std::back_inserter(with_patch),
               [](const PeerLandmark& landmark) { return landmark.patch != LandmarkPatch{}; });
  const double finds = tolerance_.expected_finds(
      viewing_angles(positions_of(with_patch), match.T_other_own, camera_));
  return static_cast<double>(match.aligned.size()) < config_.least_found_share * finds;
}

// In the own world, as far as it is known where the asker's lies. Its sigma is that of both drones'
// odometry since the start: drift that has been found since is in the alignment.
std::optional<CameraView> Collaborator::view_of_asker(const PlaceAdvert& advert) const {
  const std::optional<Eigen::Isometry3d> world = matcher_.world_of(advert.sender);
  const Keyframe* newest = database_.last();
  if (!world || !newest || config_.exchange != ExchangeMode::kCompact) return std::nullopt;
  CameraView view = advert.view;
  view.T_world_cam = *world * view.T_world_cam;
  view.sigma += view_sigma(*newest);
  return view;
}

// Not twice within a short time, and nothing that is seen from too far apart.
bool Collaborator::may_answer_with(const Keyframe& keyframe, const std::string& asker,
                                   const std::optional<CameraView>& asked_from) const {
  return !limiter_.has_just_sent(asker, keyframe.pose.keyframe_id, now_ns_) &&
         (!asked_from || sure_difference(keyframe, *asked_from) <= config_.answer_max_difference);
}

std::vector<Collaborator::RankedKeyframe> Collaborator::similar_keyframes(
    const PlaceAdvert& advert, const std::optional<CameraView>& asked_from) const {
  std::vector<RankedKeyframe> similar;
  for (const Keyframe& keyframe : database_.keyframes()) {
    if (!may_answer_with(keyframe, advert.sender, asked_from)) continue;
    const double score = place_score(config_.place_mode, advert.descriptor, keyframe.place);
    if (score >= place_threshold_) similar.push_back({&keyframe, score});
  }
  std::stable_sort(
      similar.begin(), similar.end(),
      [](const RankedKeyframe& a, const RankedKeyframe& b) { return a.score > b.score; });
  if (similar.size() > kCandidates) similar.resize(kCandidates);
  return similar;
}

std::vector<Collaborator::RankedKeyframe> Collaborator::nearest_keyframes(
    const std::string& asker, const CameraView& asked_from) const {
  std::vector<RankedKeyframe> near;
  for (const Keyframe& keyframe : database_.keyframes()) {
    if (may_answer_with(keyframe, asker, asked_from)) near.push_back({&keyframe, 1});
  }
  const auto nearer = [&](const RankedKeyframe& a, const RankedKeyframe& b) {
    return view_difference(view_of(*a.keyframe), asked_from) <
           view_difference(view_of(*b.keyframe), asked_from);
  };
  const std::size_t count = std::min(near.size(), kCandidates);
  std::partial_sort(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count), near.end(),
                    nearer);
  near.resize(count);
  return near;
}

// Corners without an estimate are of no use to the peer: where corners are compared one by one,
// only those that would be sent count.
double Collaborator::landmark_score(const PlaceAdvert& advert, const RankedKeyframe& candidate,
                                    const std::vector<KeyframeFeature>& landmarks) const {
  if (config_.place_mode != PlaceMode::kCompact || is_brief(advert)) return candidate.score;
  return common_share(advert.descriptor, describe_compact(descriptors_of(landmarks)));
}

// Those first that the advert's corners are most like: the peer will find them.
std::vector<KeyframeFeature> Collaborator::most_useful(
    const std::vector<KeyframeFeature>& landmarks, const PlaceAdvert& advert) const {
  if (config_.place_mode != PlaceMode::kCompact) return landmarks;
  std::vector<std::pair<double, std::size_t>> order;  // less is better
  for (std::size_t i = 0; i < landmarks.size(); ++i) order.emplace_back(0.0, i);
  const auto corners = describe_compact(descriptors_of(landmarks));
  for (const IndexPair& match : common_corners(corners, advert.descriptor)) {
    order[match.own].first = -corner_weight(match);
  }
  std::sort(order.begin(), order.end());
  std::vector<KeyframeFeature> useful;
  useful.reserve(order.size());
  for (const auto& [key, index] : order) useful.push_back(landmarks[index]);
  return useful;
}

std::vector<KeyframeFeature> Collaborator::in_sight(
    const std::vector<KeyframeFeature>& landmarks,
    const Eigen::Isometry3d& T_keyframe_asker) const {
  std::vector<KeyframeFeature> seen;
  const Eigen::Isometry3d T_asker_keyframe = T_keyframe_asker.inverse();
  std::copy_if(landmarks.begin(), landmarks.end(), std::back_inserter(seen),
               [&](const KeyframeFeature& landmark) {
                 return is_in_sight(camera_, T_asker_keyframe * position_of(landmark));
               });
  std::stable_sort(seen.begin(), seen.end(),
                   [](const auto& a, const auto& b) { return a.inverse_depth > b.inverse_depth; });
  return seen;
}

std::vector<KeyframeFeature> Collaborator::landmarks_of(const Keyframe& keyframe) const {
  std::vector<KeyframeFeature> landmarks;
  for (const KeyframeFeature& feature : keyframe.features) {
    if (is_certain(feature.inverse_depth, feature.inverse_depth_sigma,
                   config_.matching.max_relative_sigma)) {
      landmarks.push_back(feature);
    }
  }
  return landmarks;
}

std::variant<KeyframeMatch, NoMatch> Collaborator::match(const PeerKeyframe& message) {
  ++report_.keyframes_received;
  std::variant<KeyframeMatch, NoMatch> result = find_matches(message);
  if (const auto* none = std::get_if<NoMatch>(&result)) {
    ++report_.no_match[static_cast<std::size_t>(none->reason)];
    if (!message.described) corners_told_ns_.reset();
  } else {
    remember(message, std::get<KeyframeMatch>(result));
    learn_tolerance(message, std::get<KeyframeMatch>(result));
    ++report_.matched;
    report_.landmark_pairs += static_cast<int>(std::get<KeyframeMatch>(result).matches.size());
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

}  // namespace covey
