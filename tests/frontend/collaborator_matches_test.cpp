// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <optional>
#include <set>
#include <variant>
#include <vector>

#include "collaborating_drones.h"
#include "frontend/collaborator.h"

namespace covey {
namespace {

using testing::distance_to_own_point;
using testing::glance;
using testing::kFocal;
using testing::kOwnIds;
using testing::kPeerIds;
using testing::level_camera;
using testing::look;
using testing::make_drone;
using testing::make_scene;
using testing::pose_covariance;
using testing::reason_of;
using testing::Scene;
using testing::Team;

class Exchange : public ::testing::TestWithParam<PlaceMode> {};

TEST_P(Exchange, AdvertAnswerMatchGivesTheRightTrackPairs) {
  Team team(GetParam());
  const std::optional<PeerKeyframe> answer = team.uav1.answer(team.advert);
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->sender, "uav1");
  EXPECT_EQ(answer->receiver, "uav0");
  EXPECT_EQ(answer->request_keyframe_id, team.advert.keyframe_id);

  const auto result = team.uav0.match(*answer);
  ASSERT_TRUE(std::holds_alternative<KeyframeMatch>(result))
      << to_string(std::get<NoMatch>(result).reason);
  const KeyframeMatch& matches = std::get<KeyframeMatch>(result);
  EXPECT_EQ(matches.drone, "uav1");
  EXPECT_EQ(matches.own.stamp_ns, nanoseconds(3.0));
  EXPECT_GE(matches.matches.size(), 35u);
  std::set<std::uint64_t> own;
  for (const LandmarkMatch& match : matches.matches) {
    EXPECT_LT(distance_to_own_point(team, match), 0.15);
    EXPECT_TRUE(own.insert(match.track_id).second);
  }
  EXPECT_EQ(team.uav0.report().matched, 1);
  EXPECT_EQ(team.uav0.report().landmark_pairs, static_cast<int>(matches.matches.size()));
  EXPECT_EQ(team.uav1.report().answered, 1);
}

INSTANTIATE_TEST_SUITE_P(AllModes, Exchange,
                         ::testing::Values(PlaceMode::kPaper, PlaceMode::kMajority,
                                           PlaceMode::kCompact));

TEST(Collaborator, InThePapersExchangeEveryQuestionIsAnsweredAndItsImageFound) {
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  Collaborator asker = make_drone("uav0", ExchangeMode::kPaper);
  Collaborator other = make_drone("uav1", ExchangeMode::kPaper);
  look(other, scene, level_camera({0, 0, 0}), 1.0, kPeerIds);
  look(asker, scene, level_camera({0.5, 1.4, 0.3}, 0.1), 3.0, kOwnIds);
  for (int i = 0; i < 3; ++i) {
    const PlaceAdvert advert = glance(asker, scene, level_camera({0.5, 1.5 + 0.1 * i, 0.3}, 0.1),
                                      3.03 + 0.03 * i, kOwnIds);
    EXPECT_EQ(advert.descriptor.size(), 2048u);
    const std::optional<PeerKeyframe> answer = other.answer(advert);
    ASSERT_TRUE(answer.has_value());
    EXPECT_EQ(answer->request_keyframe_id, advert.keyframe_id);
    const auto match = asker.match(*answer);
    ASSERT_TRUE(std::holds_alternative<KeyframeMatch>(match));
    EXPECT_EQ(std::get<KeyframeMatch>(match).own.keyframe_id, advert.keyframe_id);
  }
  EXPECT_EQ(asker.report().keyframes, 1);
}

TEST(Collaborator, OnlyTheNewestImagesAreFoundByAnswers) {
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  Collaborator asker = make_drone("uav0", ExchangeMode::kPaper);
  Collaborator other = make_drone("uav1", ExchangeMode::kPaper);
  look(other, scene, level_camera({0, 0, 0}), 1.0, kPeerIds);
  const Eigen::Isometry3d here = level_camera({0.5, 1.5, 0.3}, 0.1);
  const PeerKeyframe answer = other.answer(glance(asker, scene, here, 3, kOwnIds)).value();
  for (int i = 0; i < 2; ++i) glance(asker, scene, here, 3.03 + 0.03 * i, kOwnIds);
  EXPECT_TRUE(std::holds_alternative<KeyframeMatch>(asker.match(answer)));
  glance(asker, scene, here, 3.09, kOwnIds);
  EXPECT_EQ(reason_of(asker.match(answer)), NoMatchReason::kUnknownRequest);
}

TEST(Collaborator, InTheNaiveExchangeTheNewestImagesOfBothAreMatched) {
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  Collaborator one = make_drone("uav0", ExchangeMode::kNaive);
  Collaborator other = make_drone("uav1", ExchangeMode::kNaive);
  EXPECT_FALSE(other.announcement().has_value());
  look(other, scene, level_camera({0, 0, 0}), 3.0, kPeerIds);
  glance(other, scene, level_camera({0, 0.1, 0}), 3.03, kPeerIds);
  look(one, scene, level_camera({0.5, 1.5, 0.3}, 0.1), 3.0, kOwnIds);
  glance(one, scene, level_camera({0.5, 1.6, 0.3}, 0.1), 3.03, kOwnIds);

  const std::optional<PeerKeyframe> told = other.announcement();
  ASSERT_TRUE(told.has_value());
  EXPECT_EQ(told->receiver, "");
  const auto match = one.match(*told);
  ASSERT_TRUE(std::holds_alternative<KeyframeMatch>(match));
  EXPECT_EQ(std::get<KeyframeMatch>(match).own.stamp_ns, nanoseconds(3.03));
  EXPECT_EQ(std::get<KeyframeMatch>(match).other.stamp_ns, nanoseconds(3.03));
}

TEST(Collaborator, InOtherExchangesWhatIsToldToAllIsNotForUs) {
  Team team;
  EXPECT_EQ(reason_of(team.uav0.match(team.uav1.announcement().value())), NoMatchReason::kNotForUs);
}

TEST(Collaborator, MatchSaysHowTheCamerasStandToEachOther) {
  Team team;
  const auto match = std::get<KeyframeMatch>(team.uav0.match(team.ask()));
  const Eigen::Isometry3d truth = team.looked_at.inverse() * level_camera({0.5, 1.5, 0.3}, 0.1);
  EXPECT_LT((match.T_other_own.translation() - truth.translation()).norm(), 0.05);
  EXPECT_LT((match.T_other_own.linear() - truth.linear()).norm(), 0.01);
  const double sigma = KeyframeMatcherConfig().sigma_px / kFocal;
  EXPECT_TRUE(match.matches.front().bearing_covariance.isApprox(sigma * sigma *
                                                                Eigen::Matrix2d::Identity()));
  EXPECT_TRUE(match.other.T_world_cam.isApprox(team.looked_at));
  EXPECT_EQ(match.other.covariance, pose_covariance());
}

TEST(Collaborator, ReturningToAnOwnPlaceIsNoticed) {
  Collaborator drone = make_drone("uav0");
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  look(drone, scene, level_camera({0, 0, 0}), 1.0, kOwnIds);
  look(drone, make_scene(80, {12, 60, 0}, 3), level_camera({0, 60, 0}), 4.0, 90000);
  EXPECT_TRUE(drone.revisit().empty()) << "another place";
  // One second after the first time the tracks may still be the same: nothing new.
  Collaborator hasty = make_drone("uav0");
  look(hasty, scene, level_camera({0, 0, 0}), 1.0, kOwnIds);
  look(hasty, scene, level_camera({0.5, 1.5, 0.3}, 0.1), 2.0, kPeerIds);
  EXPECT_TRUE(hasty.revisit().empty()) << "too soon";

  look(drone, scene, level_camera({0.5, 1.5, 0.3}, 0.1), 20.0, kPeerIds);
  const std::vector<KeyframeMatch> revisited = drone.revisit();
  ASSERT_EQ(revisited.size(), 1u);
  EXPECT_EQ(revisited[0].drone, "uav0");
  EXPECT_EQ(revisited[0].own.stamp_ns, nanoseconds(20));
  EXPECT_EQ(revisited[0].other.stamp_ns, nanoseconds(1));
  EXPECT_GE(revisited[0].matches.size(), 40u);
}

TEST(Collaborator, ReturningIsNoticedHoweverYoungAPlaceMayBe) {
  CollaboratorConfig config;
  config.agent = "uav0";
  config.loop_min_age_s = 0;
  Collaborator drone(config, visual_vocabulary(), testing::camera());
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  look(drone, scene, level_camera({0, 0, 0}), 1.0, kOwnIds);
  EXPECT_TRUE(drone.revisit().empty()) << "nothing is a return to itself";
  look(drone, scene, level_camera({0.5, 1.5, 0.3}, 0.1), 2.0, kPeerIds);
  const std::vector<KeyframeMatch> revisited = drone.revisit();
  ASSERT_EQ(revisited.size(), 1u);
  EXPECT_EQ(revisited[0].other.stamp_ns, nanoseconds(1));
}

TEST(Collaborator, WhatIsStillTrackedClosesNoLoop) {
  Collaborator drone = make_drone("uav0");
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  look(drone, scene, level_camera({0, 0, 0}), 1.0, kOwnIds);
  look(drone, scene, level_camera({0.5, 1.5, 0.3}, 0.1), 20.0, kOwnIds);
  EXPECT_TRUE(drone.revisit().empty());
}

TEST(Collaborator, WhereBothKnowALandmarksDepthTheyAreCompared) {
  Team team;
  const KeyframeMatch match = std::get<KeyframeMatch>(team.uav0.match(team.ask()));
  ASSERT_GT(match.matches.size(), 8u);
  for (const LandmarkMatch& landmark : match.matches) {
    const Eigen::Vector3d seen =
        match.T_other_own.inverse() *
        (landmark.other_bearing.homogeneous() / landmark.inverse_depth).eval();
    EXPECT_NEAR(landmark.own_inverse_depth * seen.z(), 1, 0.05);
    EXPECT_GT(landmark.own_inverse_depth_sigma, 0);
  }
  EXPECT_EQ(match.own_before.keyframe_id, match.own.keyframe_id) << "there is no older one";
}

TEST(Collaborator, WhatAPeerAnsweredOnceIsRecognisedWithoutAsking) {
  Team team;
  EXPECT_TRUE(std::holds_alternative<KeyframeMatch>(team.uav0.match(team.ask())));
  look(team.uav0, team.scene, level_camera({0.5, 2.5, 0.3}, 0.1), 4.0, kOwnIds);
  const std::vector<KeyframeMatch> revisited = team.uav0.revisit();
  ASSERT_EQ(revisited.size(), 1u);
  EXPECT_EQ(revisited[0].drone, "uav1");
  for (const LandmarkMatch& match : revisited[0].matches) {
    EXPECT_LT(distance_to_own_point(team, match), 0.15);
  }
}

TEST(Collaborator, WhatIsNotFoundYetIsComparedAgainFromNearer) {
  Team team;
  PeerKeyframe answer = team.ask();
  const Scene another = make_scene(80, {12, 0, 0}, 7);
  answer.request_keyframe_id =
      look(team.uav0, another, level_camera({0.5, 1.5, 0.3}, 0.1), 4.0, 90000).keyframe_id;
  (void)reason_of(team.uav0.match(answer));
  EXPECT_TRUE(team.uav0.revisit().empty()) << "still not in sight";
  look(team.uav0, team.scene, level_camera({0.5, 2.5, 0.3}, 0.1), 5.0, kOwnIds);
  const std::vector<KeyframeMatch> revisited = team.uav0.revisit();
  ASSERT_EQ(revisited.size(), 1u);
  EXPECT_EQ(revisited[0].drone, "uav1");
  for (const LandmarkMatch& match : revisited[0].matches) {
    EXPECT_LT(distance_to_own_point(team, match), 0.15);
  }
}

TEST(Collaborator, TracksThatEndedLongAgoStillMatchByTheirId) {
  Team team;
  const PeerKeyframe answer = team.ask();
  // The asking drone goes on to other tracks, in other order, before the answer comes.
  look(team.uav0, make_scene(80, {12, 40, 0}, 3), level_camera({0, 40, 0}), 5.0, 90000);
  const KeyframeMatch matches = std::get<KeyframeMatch>(team.uav0.match(answer));
  EXPECT_EQ(matches.own.stamp_ns, nanoseconds(3.0));
  for (const LandmarkMatch& match : matches.matches) {
    EXPECT_LT(distance_to_own_point(team, match), 0.15);
  }
}

}  // namespace
}  // namespace covey
