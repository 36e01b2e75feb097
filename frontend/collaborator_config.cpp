// SPDX-License-Identifier: Apache-2.0
#include "frontend/collaborator_config.h"

#include <stdexcept>

#include "frontend/message_checks.h"

namespace covey {

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

void require_workable(const CollaboratorConfig& config, const Vocabulary& vocabulary,
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

CollaboratorConfig for_exchange(CollaboratorConfig config) {
  // The paper does not tell its threshold. As high as leaves answers in the yard: they are large.
  constexpr double kThreshold = 0.28;
  if (config.exchange == ExchangeMode::kCompact) return config;
  config.place_mode = PlaceMode::kPaper;
  if (config.place_threshold == 0) config.place_threshold = kThreshold;
  config.limiter.answer_interval_s = 0;
  config.limiter.resend_interval_s = 0;
  config.limiter.landmarks_per_s = 0;
  config.limiter.max_landmarks = static_cast<int>(kMaxPeerLandmarks);
  config.corners_interval_s = 0;
  return config;
}

QuestionRules question_rules(const CollaboratorConfig& config) {
  QuestionRules rules;
  if (config.exchange == ExchangeMode::kCompact) rules.new_view = config.question;
  rules.corners_interval_s = config.corners_interval_s;
  rules.repeat_s = config.repeat_question_s;
  rules.max_strangers = config.limiter.max_peers;
  return rules;
}

AnswerRules answer_rules(const CollaboratorConfig& config) {
  AnswerRules rules;
  rules.place_mode = config.place_mode;
  rules.least_score =
      config.place_threshold > 0 ? config.place_threshold : default_threshold(config.place_mode);
  rules.max_difference = config.answer_max_difference;
  rules.min_landmarks = static_cast<std::size_t>(config.min_landmarks);
  rules.max_relative_sigma = config.matching.max_relative_sigma;
  rules.least_finds = config.matching.min_matches;
  rules.margin_px = reach_px(config.matching.patch);
  return rules;
}

}  // namespace covey
