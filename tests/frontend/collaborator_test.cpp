// SPDX-License-Identifier: Apache-2.0
#include "frontend/collaborator.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <string>

#include "collaborating_drones.h"

namespace covey {
namespace {

using testing::camera;
using testing::depths;
using testing::kOwnIds;
using testing::kPeerIds;
using testing::level_camera;
using testing::look;
using testing::make_drone;
using testing::make_scene;
using testing::pose_covariance;
using testing::Scene;
using testing::Team;
using testing::view;

TEST(Collaborator, KeyframesFollowTheBaselineOverTheMeanDepth) {
  Collaborator drone = make_drone("uav0");
  const Scene scene = make_scene(50, {20, 0, 0}, 1);
  EXPECT_TRUE(drone.wants_keyframe(nanoseconds(1), level_camera({0, 0, 0})));
  look(drone, scene, level_camera({0, 0, 0}), 1, 1);
  EXPECT_FALSE(drone.wants_keyframe(nanoseconds(2), level_camera({0, 1.3, 0})));
  EXPECT_TRUE(drone.wants_keyframe(nanoseconds(2), level_camera({0, 1.5, 0})));
}

TEST(Collaborator, AsksAboutNewViewsOnly) {
  const Scene scene = make_scene(50, {20, 0, 0}, 1);
  const auto asks = [&](Collaborator& drone, double y, double seconds) {
    (void)look(drone, scene, level_camera({0, y, 0}), seconds, 1);
    return drone.wants_to_ask();
  };
  Collaborator drone = make_drone("uav0");
  EXPECT_TRUE(asks(drone, 0, 1));
  EXPECT_FALSE(asks(drone, 1.5, 1.3)) << "too soon";
  EXPECT_TRUE(asks(drone, 1.5, 2));
  EXPECT_FALSE(asks(drone, 2.7, 3)) << "nearer to the last question's than 7 % of the depth";
  EXPECT_TRUE(asks(drone, 3.2, 4));
  Collaborator in_paper = make_drone("uav1", ExchangeMode::kPaper);
  EXPECT_TRUE(asks(in_paper, 0, 1));
  EXPECT_TRUE(asks(in_paper, 0.1, 2)) << "the paper's drones ask about each";
}

// The question is lost, then the answer; once one has come there is no need to ask again.
TEST(Collaborator, WhoHoversAsksAgainUntilItIsAnswered) {
  Team team;
  const auto hover = [&](double seconds) {
    team.uav0.set_time(nanoseconds(seconds));
    team.uav1.set_time(nanoseconds(seconds));
    return team.uav0.repeated_question();
  };
  EXPECT_FALSE(hover(4)) << "nothing has been asked";
  ASSERT_TRUE(team.uav0.wants_to_ask());
  EXPECT_FALSE(hover(6.9));
  const std::optional<PlaceAdvert> again = hover(7.1);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->keyframe_id, team.advert.keyframe_id);
  EXPECT_FALSE(again->descriptor.empty());
  EXPECT_TRUE(team.uav1.answer(*again)) << "whose answer is lost";
  EXPECT_FALSE(hover(13)) << "twice as long";
  const std::optional<PlaceAdvert> once_more = hover(13.2);
  ASSERT_TRUE(once_more);
  const std::optional<PeerKeyframe> answer = team.uav1.answer(*once_more);
  ASSERT_TRUE(answer);
  EXPECT_TRUE(std::holds_alternative<KeyframeMatch>(team.uav0.match(*answer)));
  EXPECT_FALSE(hover(100));
}

TEST(Collaborator, WhomNobodyAnswersAsksOnceAMinuteInTheEnd) {
  Team team;
  ASSERT_TRUE(team.uav0.wants_to_ask());
  int asked = 0;
  for (int second = 4; second < 3600; ++second) {
    team.uav0.set_time(nanoseconds(second));
    asked += team.uav0.repeated_question().has_value() ? 1 : 0;
  }
  EXPECT_NEAR(asked, 63, 2);
}

TEST(Collaborator, OtherPlaceGetsNoAnswer) {
  Team team;
  Collaborator stranger = make_drone("uav7");
  const PlaceAdvert advert =
      look(stranger, make_scene(80, {12, 0, 0}, 77), level_camera({0, 0, 0}), 3.0, kOwnIds);
  EXPECT_FALSE(team.uav1.answer(advert).has_value());
  EXPECT_EQ(team.uav1.report().advert_unknown_place, 1);
}

TEST(Collaborator, OnlyLandmarksOfKnownDepthAreSent) {
  Collaborator drone = make_drone("uav1");
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  const Eigen::Isometry3d T_world_cam = level_camera({0, 0, 0});
  const TrackedFrame frame = view(scene, T_world_cam, nanoseconds(1), kPeerIds, {}, 1);
  auto known = depths(scene, T_world_cam, kPeerIds, 0.003, 2);
  known.resize(30);
  known[0].inverse_depth_sigma = known[0].inverse_depth;
  known[1].inverse_depth = std::nan("");  // a filter in trouble
  drone.set_time(nanoseconds(1));
  PlaceAdvert advert = drone.add_keyframe(frame, {}, T_world_cam, pose_covariance(), known);
  advert.sender = "uav0";
  const std::optional<PeerKeyframe> answer = drone.answer(advert);
  ASSERT_TRUE(answer.has_value());
  EXPECT_GE(answer->landmarks.size(), 10u);
  EXPECT_LE(answer->landmarks.size(), 28u);
  for (const PeerLandmark& landmark : answer->landmarks) {
    EXPECT_LT(landmark.inverse_depth_sigma, 0.01 * landmark.inverse_depth);
  }
}

TEST(Collaborator, AKeyframeWithoutDepthsIsNoAnswer) {
  Collaborator drone = make_drone("uav1");
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  const Eigen::Isometry3d T_world_cam = level_camera({0, 0, 0});
  PlaceAdvert advert = drone.add_keyframe(view(scene, T_world_cam, nanoseconds(1), kPeerIds, {}, 1),
                                          {}, T_world_cam, pose_covariance(), {});
  advert.sender = "uav0";
  EXPECT_FALSE(drone.answer(advert).has_value());
}

// Two views of one place: the one that looks more alike knows next to nothing of its landmarks.
TEST(Collaborator, AnswersWithTheKeyframeThatKnowsTheLandmarks) {
  const Scene scene = make_scene(80, {12, 0, 0}, 42);
  Collaborator drone = make_drone("uav1");
  look(drone, scene, level_camera({0, 2, 0}), 1.0, kPeerIds);
  const Eigen::Isometry3d T_world_cam = level_camera({0, 0, 0});
  auto few = depths(scene, T_world_cam, kOwnIds, 0.003, 2);
  few.resize(10);
  drone.set_time(nanoseconds(2));
  PlaceAdvert advert = drone.add_keyframe(view(scene, T_world_cam, nanoseconds(2), kOwnIds, {}, 3),
                                          {}, T_world_cam, pose_covariance(), few);
  advert.sender = "uav0";
  const std::optional<PeerKeyframe> answer = drone.answer(advert);
  ASSERT_TRUE(answer.has_value());
  EXPECT_EQ(answer->pose.stamp_ns, nanoseconds(1.0));
  EXPECT_GE(answer->landmarks.size(), 40u);
}

TEST(Collaborator, SamePeerGetsTheSameKeyframeAgainOnlyLater) {
  Team team;
  EXPECT_TRUE(team.uav1.answer(team.advert).has_value());
  const auto at = [&](double seconds) {
    team.uav1.set_time(nanoseconds(seconds));
    return team.uav1.answer(team.advert).has_value();
  };
  EXPECT_FALSE(at(1.4)) << "peers are answered twice a second";
  EXPECT_EQ(team.uav1.report().advert_too_soon, 1);
  EXPECT_FALSE(at(2.5)) << "and not twice the same";
  EXPECT_EQ(team.uav1.report().advert_unknown_place, 1) << "there is no other";
  EXPECT_TRUE(at(3.1)) << "the first answer may have been lost";
  PlaceAdvert other = team.advert;
  other.sender = "uav2";
  EXPECT_TRUE(team.uav1.answer(other).has_value()) << "peers are limited one by one";
}

TEST(Collaborator, InventedPeersAreBounded) {
  Team team;
  int answered = 0;
  for (int i = 0; i < 500; ++i) {
    PlaceAdvert advert = team.advert;
    advert.sender = "ghost" + std::to_string(i);
    answered += team.uav1.answer(advert).has_value();
  }
  EXPECT_EQ(answered, 64);
}

// The question looks as if it came from where uav1 has been.
TEST(Collaborator, DoesNotAnswerWhoLooksFromTooFarAway) {
  Team team;
  PlaceAdvert far = team.advert, unsure = team.advert;
  far.view.T_world_cam.pretranslate(Eigen::Vector3d(0, 40, 0));  // of 12 m of depth
  unsure.view.T_world_cam = far.view.T_world_cam;
  unsure.view.sigma = 1;
  EXPECT_FALSE(team.uav1.answer(far).has_value());
  EXPECT_EQ(team.uav1.report().advert_unknown_place, 1);
  EXPECT_TRUE(team.uav1.answer(unsure).has_value()) << "drift may have taken it so far";
}

// Around what uav1 has seen: hardly anything of it looks alike from there.
TEST(Collaborator, DoesNotAnswerWhoSeesThePlaceFromTheSide) {
  constexpr double kDepth_m = 12;
  CollaboratorConfig config;
  config.agent = "uav1";
  config.answer_max_difference = 100;  // not what is asked about here
  const auto from_aside = [&](double angle) {
    const Team team;
    Collaborator uav1(config, visual_vocabulary(), camera());
    look(uav1, team.scene, team.looked_at, 1.0, kPeerIds);
    PlaceAdvert advert = team.advert;
    const Eigen::Translation3d middle(kDepth_m, 0, 0);
    const Eigen::AngleAxisd turn(angle, Eigen::Vector3d::UnitZ());
    advert.view.T_world_cam = middle * turn * middle.inverse() * team.looked_at;
    return uav1.answer(advert).has_value();
  };
  EXPECT_TRUE(from_aside(0.5));
  EXPECT_TRUE(from_aside(1.5));
  EXPECT_FALSE(from_aside(1.8));
  EXPECT_FALSE(from_aside(-1.8));
}

TEST(Collaborator, AnswersByLooksAloneWhileTheAskersWorldIsNotKnown) {
  CollaboratorConfig config;
  config.agent = "uav1";
  config.matching.common_start = false;
  Collaborator uav1(config, visual_vocabulary(), camera());
  const Team team;
  look(uav1, team.scene, team.looked_at, 1.0, kPeerIds);
  const Eigen::Isometry3d aside(Eigen::Translation3d(0, 40, 0));
  PlaceAdvert advert = team.advert;
  advert.view.T_world_cam = aside * advert.view.T_world_cam;
  const auto answers = [&](double seconds) {
    uav1.set_time(nanoseconds(seconds));
    return uav1.answer(advert).has_value();
  };
  EXPECT_TRUE(answers(5));
  uav1.know_world("uav0", Eigen::Isometry3d::Identity());
  EXPECT_FALSE(answers(10)) << "now it is known to be far";
  uav1.know_world("uav0", aside.inverse());
  EXPECT_TRUE(answers(15)) << "now to be near";
  advert.view.T_world_cam = aside * aside * advert.view.T_world_cam;
  advert.keyframe_id += 5;
  EXPECT_FALSE(answers(20)) << "far again";
  advert.keyframe_id -= 1;
  EXPECT_TRUE(answers(25)) << "it has started anew, who knows where";
}

// Corners go along every three seconds, four times as often while a stranger is about.
TEST(Collaborator, AsksBrieflyOfThoseWhoKnowItsWorld) {
  const Scene scene = make_scene(50, {20, 0, 0}, 1);
  CollaboratorConfig config;
  config.agent = "uav0";
  config.matching.common_start = false;
  Collaborator drone(config, visual_vocabulary(), camera());
  const auto has_corners = [&](double seconds) {
    return !drone.question(look(drone, scene, level_camera({0, 0, 0}), seconds, 1))
                .descriptor.empty();
  };
  EXPECT_TRUE(has_corners(1));
  EXPECT_FALSE(has_corners(3.9)) << "nobody has been heard";
  EXPECT_TRUE(has_corners(4));
  Collaborator uav1 = make_drone("uav1");
  PlaceAdvert heard = look(uav1, make_scene(80, {12, 0, 0}, 77), level_camera({9, 0, 0}), 4, 1);
  heard.vocabulary_hash += 1;
  EXPECT_FALSE(drone.answer(heard).has_value());
  EXPECT_EQ(drone.report().advert_other_vocabulary, 1);
  EXPECT_FALSE(has_corners(5.5)) << "they can never compare places";
  heard.vocabulary_hash -= 1;
  (void)drone.answer(heard);
  EXPECT_TRUE(has_corners(5.9)) << "uav1 does not know the way here";
  EXPECT_TRUE(has_corners(7));
  EXPECT_TRUE(has_corners(16.6));
  EXPECT_FALSE(has_corners(17.8)) << "uav1 has gone";
  EXPECT_TRUE(has_corners(19.6));
  (void)drone.answer(heard);
  EXPECT_TRUE(has_corners(20.7));
  drone.know_world("uav1", Eigen::Isometry3d::Identity());
  EXPECT_FALSE(has_corners(23.6));
  EXPECT_TRUE(has_corners(23.7));
}

TEST(Collaborator, TellsCornersRarelyWhileAnswersMatchUnlessAStrangerIsAbout) {
  Team team;
  CollaboratorConfig config;
  config.matching.common_start = false;
  config.agent = "uav0";
  Collaborator asker(config, visual_vocabulary(), camera());
  const auto asks = [&](double seconds) {
    return look(asker, team.scene, level_camera({0.5, 1.5, 0.3}, 0.1), seconds, kOwnIds);
  };
  const auto has_corners = [&](double seconds) {
    return !asker.question(asks(seconds)).descriptor.empty();
  };
  const auto finds = [&](double seconds) {
    team.advert = asks(seconds);
    team.uav1.set_time(nanoseconds(seconds));
    return std::holds_alternative<KeyframeMatch>(asker.match(team.ask()));
  };
  EXPECT_TRUE(has_corners(4));
  EXPECT_FALSE(has_corners(6));
  ASSERT_TRUE(finds(6.5));
  EXPECT_FALSE(has_corners(9.4));
  EXPECT_TRUE(has_corners(9.6)) << "nothing found for three seconds";
  ASSERT_TRUE(finds(12.5));
  EXPECT_FALSE(has_corners(13));
  PlaceAdvert stranger = team.advert;
  stranger.sender = "uav2";
  (void)asker.answer(stranger);
  EXPECT_TRUE(has_corners(13.1)) << "of whom nothing has been found";
}

TEST(Collaborator, AnswersBriefQuestionsOfThoseAloneOfWhomItKnowsWhereTheyAre) {
  const auto answers = [](bool common_start, double sigma) {
    const Team team;
    CollaboratorConfig config;
    config.agent = "uav1";
    config.matching.common_start = common_start;
    Collaborator uav1(config, visual_vocabulary(), camera());
    look(uav1, team.scene, team.looked_at, 1.0, kPeerIds);
    PlaceAdvert brief = team.advert;
    brief.descriptor.clear();
    brief.view.sigma = sigma;
    const bool answered = uav1.answer(brief).has_value();
    EXPECT_EQ(uav1.report().advert_unknown_asker, answered ? 0 : 1);
    return answered;
  };
  EXPECT_TRUE(answers(true, 0.01));
  EXPECT_FALSE(answers(true, 1));
  EXPECT_FALSE(answers(false, 0.01));
}

// Nobody knows where one is who said where it started, roughly, and has gone far.
TEST(Collaborator, ABriefQuestionFromFarOffIsNotAnsweredUntilItIsKnownHowWrongStartsWere) {
  CollaboratorConfig config;
  config.agent = "uav1";
  config.matching.start_yaw_sigma = 0.2;
  Collaborator uav1(config, visual_vocabulary(), camera());
  const Team team;
  look(uav1, team.scene, level_camera({0, -80, 0}), 0.5, kPeerIds + 500);
  look(uav1, team.scene, team.looked_at, 1.0, kPeerIds);
  PlaceAdvert brief = team.advert;
  brief.descriptor.clear();
  EXPECT_FALSE(uav1.answer(brief).has_value());
  EXPECT_EQ(uav1.report().advert_unknown_asker, 1);
  uav1.know_world("uav0", Eigen::Isometry3d::Identity());
  EXPECT_TRUE(uav1.answer(brief).has_value());
}

// What lies outside of the asker's image is not sent.
TEST(Collaborator, ABriefAnswerHasNoDescriptorsAndOnlyWhatIsInSight) {
  Team team;
  PlaceAdvert brief = team.advert;
  brief.descriptor.clear();
  const std::optional<PeerKeyframe> answer = team.uav1.answer(brief);
  ASSERT_TRUE(answer.has_value());
  EXPECT_FALSE(answer->described);
  EXPECT_GE(answer->landmarks.size(), 8u);
  const Eigen::Isometry3d T_asker_seen = brief.view.T_world_cam.inverse() * team.looked_at;
  for (const PeerLandmark& landmark : answer->landmarks) {
    const Eigen::Vector3d p =
        T_asker_seen * (landmark.bearing.homogeneous() / landmark.inverse_depth).eval();
    ASSERT_GT(p.z(), 0);
    EXPECT_TRUE(is_in_image(camera(), project(camera(), p.hnormalized())));
  }
}

}  // namespace
}  // namespace covey
