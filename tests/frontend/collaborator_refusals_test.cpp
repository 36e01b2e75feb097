// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <variant>

#include "collaborating_drones.h"
#include "frontend/collaborator.h"

namespace covey {
namespace {

using testing::camera;
using testing::kOwnIds;
using testing::level_camera;
using testing::look;
using testing::reason_of;
using testing::Team;

TEST(Collaborator, RefusesAdvertsThatCannotBeCompared) {
  Team team;
  PlaceAdvert own = team.advert, other_words = team.advert, short_one = team.advert,
              nameless = team.advert;
  own.sender = "uav1";
  other_words.vocabulary_hash ^= 1;
  short_one.descriptor.pop_back();
  nameless.sender.clear();
  for (const PlaceAdvert& advert : {own, other_words, short_one, nameless}) {
    EXPECT_FALSE(team.uav1.answer(advert).has_value());
  }
  Team paper(PlaceMode::kPaper);
  EXPECT_FALSE(team.uav1.answer(paper.advert).has_value()) << "another place mode";
  EXPECT_EQ(team.uav1.report().advert_own, 1);
  EXPECT_EQ(team.uav1.report().advert_other_vocabulary, 2);
  EXPECT_EQ(team.uav1.report().advert_malformed, 2);
}

TEST(Collaborator, RefusesAnswersThatAreNotForItOrNotAskedFor) {
  Team team;
  PeerKeyframe answer = team.ask();
  answer.receiver = "uav2";
  EXPECT_EQ(reason_of(team.uav0.match(answer)), NoMatchReason::kNotForUs);
  answer.receiver = answer.sender = "uav0";
  EXPECT_EQ(reason_of(team.uav0.match(answer)), NoMatchReason::kNotForUs);
  answer.sender = "uav1";
  answer.request_keyframe_id = 999;
  EXPECT_EQ(reason_of(team.uav0.match(answer)), NoMatchReason::kUnknownRequest);
  EXPECT_EQ(team.uav0.report().no_match[static_cast<int>(NoMatchReason::kNotForUs)], 2);
}

TEST(Collaborator, RefusesAnotherPlaceSentAsAnswer) {
  Team team;
  PeerKeyframe answer = team.ask();
  std::mt19937 random(9);
  for (PeerLandmark& landmark : answer.landmarks) {
    for (std::uint8_t& byte : landmark.descriptor) byte = static_cast<std::uint8_t>(random());
  }
  const NoMatchReason reason = reason_of(team.uav0.match(answer));
  EXPECT_TRUE(reason == NoMatchReason::kTooFewMatches || reason == NoMatchReason::kTooFewInliers);
}

TEST(Collaborator, RefusesPermutedDescriptors) {
  Team team;
  PeerKeyframe answer = team.ask();
  const std::size_t size = answer.landmarks.size();
  const ShortDescriptor first = answer.landmarks[0].descriptor;
  for (std::size_t i = 0; i + 1 < size; ++i) {
    answer.landmarks[i].descriptor = answer.landmarks[i + 1].descriptor;
  }
  answer.landmarks[size - 1].descriptor = first;
  EXPECT_EQ(reason_of(team.uav0.match(answer)), NoMatchReason::kTooFewInliers);
}

TEST(Collaborator, RefusesAWorldThatIsFiveMetresOff) {
  Team team;
  PeerKeyframe answer = team.ask();
  answer.pose.T_world_cam.translation().y() += 5;
  EXPECT_EQ(reason_of(team.uav0.match(answer)), NoMatchReason::kOffsetTooLarge);
}

TEST(Collaborator, TakesOneThatIsKnownToLieFiveMetresOff) {
  Team team;
  PeerKeyframe answer = team.ask();
  Eigen::Isometry3d T_own_peer = Eigen::Isometry3d::Identity();
  T_own_peer.translation().y() = 5;
  answer.pose.T_world_cam = T_own_peer.inverse() * answer.pose.T_world_cam;
  team.uav0.know_world("uav1", T_own_peer);
  const auto result = team.uav0.match(answer);
  const auto* match = std::get_if<KeyframeMatch>(&result);
  ASSERT_NE(match, nullptr) << to_string(std::get<NoMatch>(result).reason);
  const Eigen::Isometry3d T_other_own = team.looked_at.inverse() * match->own.T_world_cam;
  EXPECT_LT((match->T_other_own.translation() - T_other_own.translation()).norm(), 0.1);
}

// A heading that was measured 0.1 rad wrong, 50 m away.
TEST(Collaborator, FarFromItsStartAWorldThatIsTurnedMayLieFiveMetresOff) {
  const auto offset_is_too_large = [](double start_yaw_sigma) {
    Team team;
    CollaboratorConfig config;
    config.agent = "uav0";
    config.matching.start_yaw_sigma = start_yaw_sigma;
    team.uav0 = Collaborator(config, visual_vocabulary(), camera());
    look(team.uav0, team.scene, level_camera({0, -50, 0}), 2.0, kOwnIds + 500);
    team.advert = look(team.uav0, team.scene, level_camera({0.5, 1.5, 0.3}, 0.1), 3.0, kOwnIds);
    PeerKeyframe answer = team.ask();
    answer.pose.T_world_cam.translation().y() += 5;
    const auto result = team.uav0.match(answer);
    const auto* none = std::get_if<NoMatch>(&result);
    return none != nullptr && none->reason == NoMatchReason::kOffsetTooLarge;
  };
  EXPECT_TRUE(offset_is_too_large(0));
  EXPECT_FALSE(offset_is_too_large(0.03));
}

TEST(Collaborator, ToleratesTheDriftOfAPeer) {
  Team team;
  PeerKeyframe answer = team.ask();
  answer.pose.T_world_cam.translation().y() += 0.5;
  EXPECT_TRUE(std::holds_alternative<KeyframeMatch>(team.uav0.match(answer)));
}

TEST(Collaborator, OneLandmarkSentManyTimesIsNoMatch) {
  Team team;
  PeerKeyframe answer = team.ask();
  std::fill(answer.landmarks.begin() + 1, answer.landmarks.end(), answer.landmarks.front());
  EXPECT_EQ(reason_of(team.uav0.match(answer)), NoMatchReason::kTooFewMatches);
}

TEST(Collaborator, SurvivesHostileMessages) {
  Team team;
  const PeerKeyframe good = team.ask();
  const double nan = std::nan(""), infinity = std::numeric_limits<double>::infinity();
  const auto malformed = [&](auto change) {
    PeerKeyframe bad = good;
    change(bad, bad.landmarks[3]);
    return reason_of(team.uav0.match(bad)) == NoMatchReason::kMalformed;
  };
  EXPECT_TRUE(malformed([&](auto& k, auto&) { k.pose.T_world_cam.translation().z() = nan; }));
  EXPECT_TRUE(malformed([&](auto& k, auto&) { k.pose.T_world_cam.translation().x() = infinity; }));
  EXPECT_TRUE(malformed([&](auto& k, auto&) { k.pose.T_world_cam.translation().x() = 1e300; }));
  EXPECT_TRUE(malformed([&](auto& k, auto&) { k.pose.T_world_cam.linear()(0, 0) = nan; }));
  EXPECT_TRUE(malformed([&](auto& k, auto&) { k.pose.covariance(0, 1) = nan; }));
  EXPECT_TRUE(malformed([&](auto&, auto& l) { l.bearing.x() = nan; }));
  EXPECT_TRUE(malformed([&](auto&, auto& l) { l.inverse_depth = nan; }));
  EXPECT_TRUE(malformed([&](auto&, auto& l) { l.inverse_depth = 0; }));
  EXPECT_TRUE(malformed([&](auto&, auto& l) { l.inverse_depth = -0.1; }));
  EXPECT_TRUE(malformed([&](auto& k, auto&) { k.pose.T_world_cam.linear() *= 2; }));
  EXPECT_TRUE(malformed([&](auto&, auto& l) { l.inverse_depth_sigma = infinity; }));

  PeerKeyframe endless = good;
  endless.landmarks.resize(257, good.landmarks[0]);
  EXPECT_EQ(reason_of(team.uav0.match(endless)), NoMatchReason::kMalformed);
  PeerKeyframe empty = good;
  empty.landmarks.clear();
  EXPECT_EQ(reason_of(team.uav0.match(empty)), NoMatchReason::kTooFewMatches);
  PeerKeyframe nameless = good;
  nameless.sender.clear();
  EXPECT_EQ(reason_of(team.uav0.match(nameless)), NoMatchReason::kMalformed);
  EXPECT_TRUE(std::holds_alternative<KeyframeMatch>(team.uav0.match(good))) << "none the worse";
}

TEST(Collaborator, QuestionsThatNobodyAnswersLeaveNoTrace) {
  Team team;
  const double nan = std::nan("");
  const auto refused = [&](auto change) {
    PlaceAdvert bad = team.advert;
    bad.keyframe_id = 1'000'000;  // as if uav0 had flown far
    change(bad);
    return !team.uav1.answer(bad).has_value();
  };
  EXPECT_TRUE(refused([&](PlaceAdvert& a) { a.view.T_world_cam.translation().x() = nan; }));
  EXPECT_TRUE(refused([&](PlaceAdvert& a) { a.view.T_world_cam.linear() *= 2; }));
  EXPECT_TRUE(refused([&](PlaceAdvert& a) { a.view.mean_depth = 0; }));
  EXPECT_TRUE(refused([&](PlaceAdvert& a) { a.view.mean_depth = nan; }));
  EXPECT_TRUE(refused([&](PlaceAdvert& a) { a.view.sigma = nan; }));
  EXPECT_EQ(team.uav1.report().advert_malformed, 5);
  EXPECT_TRUE(refused([&](PlaceAdvert& a) { ++a.vocabulary_hash; }));
  team.uav1.know_world("uav0", Eigen::Isometry3d::Identity());
  EXPECT_TRUE(refused([&](PlaceAdvert& a) { ++a.vocabulary_hash; }));
  EXPECT_FALSE(team.uav1.has_started_anew(team.advert));
  EXPECT_TRUE(team.uav1.answer(team.advert).has_value());
}

TEST(Collaborator, ConfigurationThatCannotWorkIsRefusedByName) {
  const auto message_of = [](auto change) -> std::string {
    CollaboratorConfig config;
    change(config);
    try {
      Collaborator drone(config, visual_vocabulary(), camera());
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_NE(message_of([](auto& c) { c.agent.clear(); }).find("agent"), std::string::npos);
  EXPECT_NE(message_of([](auto& c) { c.limiter.max_landmarks = 2; }).find("max_landmarks"),
            std::string::npos);
  EXPECT_NE(message_of([](auto& c) { c.database.capacity = 3; }).find("capacity"),
            std::string::npos);
  EXPECT_THROW(Collaborator({}, Vocabulary{}, camera()), std::runtime_error);
  EXPECT_THROW(Collaborator({}, visual_vocabulary(), CameraIntrinsics()), std::runtime_error);
}

}  // namespace
}  // namespace covey
