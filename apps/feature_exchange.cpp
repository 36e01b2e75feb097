// SPDX-License-Identifier: Apache-2.0
#include "apps/feature_exchange.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <unordered_set>
#include <utility>
#include <variant>

#include "comms/checks.h"
#include "comms/convert.h"
#include "frontend/compact_place.h"
#include "frontend/depth_refinement.h"
#include "frontend/nearest_views.h"
#include "sim/random.h"

namespace covey {
namespace {

CameraView view_of(const Eigen::Isometry3d& T_world_cam_true, double mean_depth) {
  return {T_world_cam_true, mean_depth};
}

// Pairs of features that show the same landmark; both lists rise.
std::vector<std::pair<const FlownFeature*, const FlownFeature*>> common(
    const std::vector<FlownFeature>& a, const std::vector<FlownFeature>& b) {
  std::vector<std::pair<const FlownFeature*, const FlownFeature*>> pairs;
  std::size_t i = 0, k = 0;
  while (i < a.size() && k < b.size()) {
    if (a[i].landmark == b[k].landmark) {
      pairs.emplace_back(&a[i++], &b[k++]);
    } else {
      ++(a[i].landmark < b[k].landmark ? i : k);
    }
  }
  return pairs;
}

constexpr double kPatchSpacing = 0.00275;  // whose patches only count as bytes here

}  // namespace

FeatureExchange::FeatureExchange(const FeatureExchangeConfig& config,
                                 std::vector<std::string> names)
    : config_(config) {
  for (std::string& name : names) {
    drones_.push_back({std::move(name),
                       false,
                       {},
                       AnswerLimiter(config.limits.limiter),
                       {},
                       {},
                       false,
                       {},
                       {},
                       {}});
  }
}

void FeatureExchange::falsify(std::size_t drone, const Falsehood& falsehood) {
  drones_[drone].falsehood = falsehood;
}

void FeatureExchange::add_keyframe(std::size_t drone, const FlownKeyframe& keyframe) {
  Drone& self = drones_[drone];
  const KeyframePose before =
      measured_since(self.keyframes, keyframe.pose, config_.limits.depth_memory_s);
  refine_newest(self.keyframes, config_.limits.database.protected_newest, keyframe,
                [](const FlownFeature& feature) { return feature.landmark; });
  self.keyframes.push_back(keyframe);
  self.keyframes.back().before = before;
}

void FeatureExchange::count_question(Drone& self, const FlownKeyframe& keyframe) const {
  self.last_asked = keyframe.pose;
  self.asks_briefly =
      may_ask_briefly(config_.limits.corners_interval_s, self.questions, keyframe.pose.stamp_ns);
  if (!self.asks_briefly) self.questions.corners_told_ns = keyframe.pose.stamp_ns;
  const std::size_t corners =
      self.asks_briefly ? 0 : std::min(keyframe.features.size(), kCompactCorners);
  const PlaceAdvert advert{self.name,
                           keyframe.pose.keyframe_id,
                           keyframe.pose.stamp_ns,
                           1,
                           {},
                           std::vector<std::uint8_t>(corners * kCompactBytes)};
  self.traffic.advert_bytes += encode(advert).size();
}

std::vector<KeyframeMatch> FeatureExchange::revisit(std::size_t drone) const {
  const Drone& self = drones_[drone];
  const FlownKeyframe& newest = self.keyframes.back();
  const CameraView view = view_of(newest.T_world_cam_true, newest.mean_depth);
  NearestViews<std::size_t, Sight> nearest(config_.limits.revisit_max_difference,
                                           config_.limits.max_revisits);
  const auto consider = [&](const Sight& sight) {
    nearest.consider(sight.drone,
                     view_difference(view_of(sight.T_world_cam_true, sight.mean_depth), view),
                     sight);
  };
  for (const FlownKeyframe& old : self.keyframes) {
    if (!config_.own_loops) break;
    if (seconds_between(old.pose.stamp_ns, newest.pose.stamp_ns) < config_.limits.loop_min_age_s)
      break;
    consider(sight_of(drone, old));
  }
  for (const Sight& peer : self.remembered) consider(peer);

  std::vector<KeyframeMatch> matches;
  for (const Sight& sight : nearest.take()) {
    if (auto found = match(drone, newest, sight)) matches.push_back(std::move(*found));
  }
  return matches;
}

std::vector<KeyframeMatch> FeatureExchange::ask(std::size_t drone) {
  Drone& self = drones_[drone];
  std::vector<KeyframeMatch> matches;
  const FlownKeyframe& own = self.keyframes.back();
  if (self.silent ||
      !is_worth_asking(config_.limits.question, self.last_asked, own.pose, own.mean_depth)) {
    return matches;
  }
  count_question(self, own);
  for (std::size_t peer = 0; peer < drones_.size(); ++peer) {
    if (peer == drone || drones_[peer].silent) continue;
    AnswerLimiter& limiter = drones_[peer].limiter;
    if (!limiter.allows(self.name, own.pose.stamp_ns)) continue;
    const std::optional<Sight> best = best_answer(peer, self.name, own);
    if (!best) continue;
    limiter.sent(self.name, best->pose.keyframe_id, own.pose.stamp_ns);
    const std::optional<Sight> received = send(drone, own.pose.keyframe_id, *best);
    if (!received) continue;
    auto found = match(drone, own, *received);
    if (!found) continue;
    self.questions.found_ns = own.pose.stamp_ns;
    matches.insert(matches.end(), static_cast<std::size_t>(config_.copies), *found);
    const bool known =
        std::any_of(self.remembered.begin(), self.remembered.end(), [&](const Sight& sight) {
          return sight.drone == peer && sight.pose.keyframe_id == received->pose.keyframe_id;
        });
    if (known) continue;
    if (self.remembered.size() >= config_.limits.remembered) self.remembered.pop_front();
    self.remembered.push_back(*received);
  }
  return matches;
}

FeatureExchange::Sight FeatureExchange::sight_of(std::size_t drone,
                                                 const FlownKeyframe& keyframe) const {
  Sight sight{drone, keyframe.pose, keyframe.before, keyframe.T_world_cam_true, keyframe.mean_depth,
              {}};
  for (const FlownFeature& feature : keyframe.features) {
    const bool wanted = config_.landmarks == SharedLandmarks::kAll ||
                        (config_.landmarks == SharedLandmarks::kSlam) == feature.slam;
    if (wanted && is_certain(feature.inverse_depth, feature.inverse_depth_sigma,
                             config_.limits.matching.max_relative_sigma))
      sight.landmarks.push_back(feature);
  }
  return sight;
}

// At most so many, first those that the asking one sees too, rising landmarks.
void FeatureExchange::keep_most_useful(Sight& sight, const FlownKeyframe& seen,
                                       std::size_t most) const {
  if (sight.landmarks.size() <= most) return;
  std::unordered_set<std::size_t> shared;
  for (const auto& [theirs, own] : common(seen.features, sight.landmarks)) {
    shared.insert(own->landmark);
  }
  const auto by_landmark = [](const FlownFeature& a, const FlownFeature& b) {
    return a.landmark < b.landmark;
  };
  std::stable_partition(
      sight.landmarks.begin(), sight.landmarks.end(),
      [&](const FlownFeature& feature) { return shared.count(feature.landmark) > 0; });
  sight.landmarks.resize(most);
  std::sort(sight.landmarks.begin(), sight.landmarks.end(), by_landmark);
}

// The keyframe that shares most with what the asking one sees, of the larger one's features, and
// that was not just sent.
std::optional<FeatureExchange::Sight> FeatureExchange::best_answer(
    std::size_t drone, const std::string& asker, const FlownKeyframe& seen) const {
  const AnswerLimiter& limiter = drones_[drone].limiter;
  std::optional<Sight> best;
  double best_score = 0;
  for (const FlownKeyframe& keyframe : drones_[drone].keyframes) {
    if (limiter.has_just_sent(asker, keyframe.pose.keyframe_id, seen.pose.stamp_ns)) continue;
    Sight sight = sight_of(drone, keyframe);
    const std::size_t shared = common(seen.features, sight.landmarks).size();
    if (shared < static_cast<std::size_t>(config_.limits.min_landmarks)) continue;
    const double score =
        static_cast<double>(shared) /
        static_cast<double>(std::max(seen.features.size(), sight.landmarks.size()));
    if (score <= best_score) continue;
    best_score = score;
    best = std::move(sight);
  }
  if (!best) return best;
  const int most = limiter.max_landmarks(asker, seen.pose.stamp_ns);
  keep_most_useful(*best, seen, static_cast<std::size_t>(most));
  return best;
}

std::optional<PeerKeyframe> FeatureExchange::deliver(std::size_t sender, PeerKeyframe message) {
  const Falsehood& falsehood = drones_[sender].falsehood;
  const double variances = falsehood.claimed_sigmas * falsehood.claimed_sigmas;
  for (KeyframePose* pose : {&message.pose, &message.before}) {
    pose->T_world_cam.translation() += falsehood.offset_world;
    pose->covariance *= variances;
  }
  if (message.found) message.found->covariance *= variances;
  if (problem_with(message)) return std::nullopt;
  const Bytes bytes = encode(message);
  auto decoded = decode_peer_keyframe(bytes);
  if (std::holds_alternative<Rejected>(decoded)) return std::nullopt;
  drones_[sender].traffic.answer_bytes += bytes.size();
  return std::get<PeerKeyframe>(std::move(decoded));
}

std::optional<FeatureExchange::Sight> FeatureExchange::send(std::size_t receiver,
                                                            std::uint64_t request,
                                                            const Sight& sight) {
  PeerKeyframe message;
  message.sender = drones_[sight.drone].name;
  message.receiver = drones_[receiver].name;
  message.request_keyframe_id = request;
  message.pose = sight.pose;
  message.before = sight.before;
  message.patch_spacing = kPatchSpacing;
  message.described = !drones_[receiver].asks_briefly;
  for (const FlownFeature& landmark : sight.landmarks) {
    message.landmarks.push_back(
        {{}, landmark.bearing, landmark.inverse_depth, landmark.inverse_depth_sigma, {}});
  }
  const std::optional<PeerKeyframe> arrived = deliver(sight.drone, std::move(message));
  if (!arrived) return std::nullopt;
  Sight received = sight;
  received.pose = arrived->pose;
  received.before = arrived->before;
  for (std::size_t i = 0; i < received.landmarks.size(); ++i) {
    received.landmarks[i].bearing = arrived->landmarks[i].bearing;
    received.landmarks[i].inverse_depth = arrived->landmarks[i].inverse_depth;
    received.landmarks[i].inverse_depth_sigma = arrived->landmarks[i].inverse_depth_sigma;
  }
  return received;
}

std::optional<FeatureExchange::Told> FeatureExchange::tell(std::size_t drone,
                                                           const RelativePose& found) {
  const auto receiver = std::find_if(drones_.begin(), drones_.end(),
                                     [&](const Drone& other) { return other.name == found.drone; });
  const bool heard = receiver != drones_.end() && receiver->name != drones_[drone].name;
  if (!heard || !config_.limits.tell_found) return std::nullopt;
  const auto own = std::find_if(receiver->keyframes.begin(), receiver->keyframes.end(),
                                [&](const FlownKeyframe& keyframe) {
                                  return keyframe.pose.keyframe_id == found.other.keyframe_id;
                                });
  if (own == receiver->keyframes.end()) return std::nullopt;
  const auto message = deliver(drone, as_told(found, drones_[drone].name));
  if (!message) return std::nullopt;
  return Told{static_cast<std::size_t>(receiver - drones_.begin()),
              found_by_peer(*message, own->pose, own->before, own->mean_depth)};
}

// The rough relative pose, which geometric verification finds from descriptors, is the true one.
std::optional<KeyframeMatch> FeatureExchange::match(std::size_t drone, const FlownKeyframe& own,
                                                    const Sight& other) const {
  const auto pairs = common(own.features, other.landmarks);
  if (pairs.size() < static_cast<std::size_t>(config_.limits.matching.min_matches))
    return std::nullopt;
  KeyframeMatch match;
  match.drone = drones_[other.drone].name;
  match.own = own.pose;
  match.own_before = own.before;
  match.own_mean_depth = own.mean_depth;
  match.other = other.pose;
  match.other_before = other.before;
  match.T_other_own = other.T_world_cam_true.inverse() * own.T_world_cam_true;
  // Both bearings are measured, and their corners are not the same.
  const double variance = 2 * config_.bearing_sigma * config_.bearing_sigma +
                          config_.corner_mismatch * config_.corner_mismatch;
  for (const auto& [mine, theirs] : pairs) {
    LandmarkMatch one;
    one.track_id = mine->track_id;
    one.bearing = mine->bearing + mismatch(drone, mine->track_id, other.drone, theirs->track_id);
    one.other_bearing = theirs->bearing;
    one.inverse_depth = theirs->inverse_depth;
    one.inverse_depth_sigma = theirs->inverse_depth_sigma;
    one.bearing_covariance = variance * Eigen::Matrix2d::Identity();
    add_own_depth(*mine, config_.limits.matching.max_relative_sigma, one);
    match.matches.push_back(one);
  }
  return match;
}

// Constant for a pair of tracks, the opposite seen from the other side, none of a track with
// itself.
Eigen::Vector2d FeatureExchange::mismatch(std::size_t drone, std::uint64_t track,
                                          std::size_t other_drone,
                                          std::uint64_t other_track) const {
  const std::pair<std::uint64_t, std::uint64_t> here(drone, track), there(other_drone, other_track);
  if (here == there) return Eigen::Vector2d::Zero();
  const auto& [first, second] = std::minmax(here, there);
  const std::uint64_t tracks = (first.second << 32) + second.second;
  const std::uint64_t drones = (first.first << 32) + second.first;
  Random random(config_.seed + (drones << 8), tracks);
  const double x = random.gaussian(), y = random.gaussian();
  return (here < there ? 1 : -1) * config_.corner_mismatch * Eigen::Vector2d(x, y);
}

}  // namespace covey
