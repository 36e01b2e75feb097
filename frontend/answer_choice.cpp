// SPDX-License-Identifier: Apache-2.0
#include "frontend/answer_choice.h"

#include <algorithm>
#include <cstddef>
#include <iterator>
#include <utility>

#include "frontend/compact_place.h"
#include "frontend/keyframe_matcher.h"

namespace covey {
namespace {

constexpr std::size_t kCandidates = 5;  // of which the best is taken

constexpr double kSigmas = 3;  // of where a question was asked from, that drift may have made

struct RankedKeyframe {
  const Keyframe* keyframe = nullptr;
  double score = 0;
};

// Between a keyframe's view and the one that was asked from, at least: drift may have made the
// rest.
double sure_difference(const Keyframe& keyframe, const CameraView& asked_from) {
  return view_difference(view_of(keyframe), asked_from) - kSigmas * asked_from.sigma;
}

// The same landmarks tell a relative pose the better the nearer the views are, until a difference
// of about kLeastDifference.
double worth_of(double score, const Keyframe& keyframe,
                const std::optional<CameraView>& asked_from) {
  constexpr double kLeastDifference = 0.3;
  if (!asked_from) return score;
  return score / (kLeastDifference + view_difference(view_of(keyframe), *asked_from));
}

// Nothing that is seen from too far apart.
std::vector<const Keyframe*> in_reach(const std::vector<const Keyframe*>& stored,
                                      const std::optional<CameraView>& asked_from,
                                      double max_difference) {
  if (!asked_from) return stored;
  std::vector<const Keyframe*> near;
  std::copy_if(stored.begin(), stored.end(), std::back_inserter(near),
               [&](const Keyframe* keyframe) {
                 return sure_difference(*keyframe, *asked_from) <= max_difference;
               });
  return near;
}

std::vector<RankedKeyframe> similar_keyframes(const AnswerRules& rules,
                                              const std::vector<const Keyframe*>& stored,
                                              const PlaceAdvert& advert) {
  std::vector<RankedKeyframe> similar;
  for (const Keyframe* keyframe : stored) {
    const double score = place_score(rules.place_mode, advert.descriptor, keyframe->place);
    if (score >= rules.least_score) similar.push_back({keyframe, score});
  }
  std::stable_sort(
      similar.begin(), similar.end(),
      [](const RankedKeyframe& a, const RankedKeyframe& b) { return a.score > b.score; });
  if (similar.size() > kCandidates) similar.resize(kCandidates);
  return similar;
}

std::vector<RankedKeyframe> nearest_keyframes(const std::vector<const Keyframe*>& stored,
                                              const CameraView& asked_from) {
  std::vector<RankedKeyframe> near;
  near.reserve(stored.size());
  for (const Keyframe* keyframe : stored) {
    near.push_back({keyframe, view_difference(view_of(*keyframe), asked_from)});
  }
  const std::size_t count = std::min(near.size(), kCandidates);
  std::partial_sort(
      near.begin(), near.begin() + static_cast<std::ptrdiff_t>(count), near.end(),
      [](const RankedKeyframe& a, const RankedKeyframe& b) { return a.score < b.score; });
  near.resize(count);
  for (RankedKeyframe& keyframe : near) keyframe.score = 1;
  return near;
}

// Corners without an estimate are of no use to the peer: where corners are compared one by one,
// only those that would be sent count.
double landmark_score(const AnswerRules& rules, const PlaceAdvert& advert,
                      const RankedKeyframe& candidate,
                      const std::vector<KeyframeFeature>& landmarks) {
  if (rules.place_mode != PlaceMode::kCompact || is_brief(advert)) return candidate.score;
  return common_share(advert.descriptor, describe_compact(descriptors_of(landmarks)));
}

// Chance finds grow with what is looked for, and half of all finds must agree: hence a share.
bool would_be_found(const AnswerRules& rules, const ChosenAnswer& answer, const Question& question,
                    const ViewpointTolerance& tolerance, const CameraIntrinsics& camera) {
  constexpr double kMinShare = 0.25;
  const CameraView& asked_from = *question.asked_from;
  if (!is_sure(asked_from, tolerance)) return true;  // nobody knows
  const std::vector<double> angles =
      viewing_angles(positions_of(answer.landmarks),
                     answer.keyframe->pose.T_world_cam.inverse() * asked_from.T_world_cam, camera);
  const double finds = tolerance.expected_finds(angles);
  const double sent = std::min(1.0, static_cast<double>(question.max_landmarks) /
                                        static_cast<double>(answer.landmarks.size()));
  return sent * finds >= rules.least_finds &&
         finds >= kMinShare * static_cast<double>(angles.size());
}

// Those first that the advert's corners are most like: the peer will find them.
std::vector<KeyframeFeature> most_alike(const std::vector<KeyframeFeature>& landmarks,
                                        const PlaceAdvert& advert) {
  std::vector<std::pair<double, std::size_t>> order;  // less is better
  for (std::size_t i = 0; i < landmarks.size(); ++i) order.emplace_back(0.0, i);
  const auto corners = describe_compact(descriptors_of(landmarks));
  for (const IndexPair& match : common_corners(corners, advert.descriptor)) {
    order[match.own].first = -corner_weight(match);
  }
  std::sort(order.begin(), order.end());
  std::vector<KeyframeFeature> alike;
  alike.reserve(order.size());
  for (const auto& [key, index] : order) alike.push_back(landmarks[index]);
  return alike;
}

// Those in the asker's image: first the nearest, which tell most of the way.
std::vector<KeyframeFeature> in_sight(const std::vector<KeyframeFeature>& landmarks,
                                      const Eigen::Isometry3d& T_asker_keyframe,
                                      const CameraIntrinsics& camera, double margin_px) {
  std::vector<KeyframeFeature> seen;
  std::copy_if(landmarks.begin(), landmarks.end(), std::back_inserter(seen),
               [&](const KeyframeFeature& landmark) {
                 return is_in_sight(camera, T_asker_keyframe * position_of(landmark), margin_px);
               });
  std::stable_sort(seen.begin(), seen.end(),
                   [](const auto& a, const auto& b) { return a.inverse_depth > b.inverse_depth; });
  return seen;
}

void keep_most_useful(const AnswerRules& rules, const Question& question,
                      const CameraIntrinsics& camera, ChosenAnswer& answer) {
  std::vector<KeyframeFeature>& landmarks = answer.landmarks;
  if (is_brief(*question.advert)) {
    const Eigen::Isometry3d T_asker_keyframe =
        question.asked_from->T_world_cam.inverse() * answer.keyframe->pose.T_world_cam;
    landmarks = in_sight(landmarks, T_asker_keyframe, camera, rules.margin_px);
  } else if (rules.place_mode == PlaceMode::kCompact) {
    landmarks = most_alike(landmarks, *question.advert);
  }
  landmarks.resize(std::min(landmarks.size(), question.max_landmarks));
}

}  // namespace

bool is_brief(const PlaceAdvert& advert) { return advert.descriptor.empty(); }

bool is_sure(const CameraView& view, const ViewpointTolerance& tolerance) {
  return kSigmas * view.sigma <= tolerance.tolerance();
}

std::optional<ChosenAnswer> choose_answer(const AnswerRules& rules,
                                          const std::vector<const Keyframe*>& stored,
                                          const Question& question,
                                          const ViewpointTolerance& tolerance,
                                          const CameraIntrinsics& camera) {
  const PlaceAdvert& advert = *question.advert;
  const auto& asked_from = question.asked_from;
  const std::vector<const Keyframe*> near = in_reach(stored, asked_from, rules.max_difference);
  std::optional<ChosenAnswer> best;
  double best_worth = 0;
  for (const RankedKeyframe& candidate : is_brief(advert)
                                             ? nearest_keyframes(near, *asked_from)
                                             : similar_keyframes(rules, near, advert)) {
    ChosenAnswer answer{candidate.keyframe,
                        landmarks_of(*candidate.keyframe, rules.max_relative_sigma)};
    if (answer.landmarks.size() < rules.min_landmarks) continue;
    if (asked_from && !would_be_found(rules, answer, question, tolerance, camera)) continue;
    const double score = landmark_score(rules, advert, candidate, answer.landmarks);
    if (score < rules.least_score) continue;
    const double worth = worth_of(score, *candidate.keyframe, asked_from);
    if (worth < best_worth) continue;
    best_worth = worth;
    best = std::move(answer);
  }
  if (best) keep_most_useful(rules, question, camera, *best);
  return best;
}

}  // namespace covey
