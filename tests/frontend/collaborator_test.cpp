// SPDX-License-Identifier: Apache-2.0
#include "frontend/collaborator.h"

#include <gtest/gtest.h>

#include <limits>
#include <set>
#include <string>

#include "frontend/vocabulary_visual.h"
#include "synthetic_places.h"

namespace covey {
namespace {

using testing::depths;
using testing::level_camera;
using testing::make_scene;
using testing::Scene;
using testing::view;

constexpr double kFocal = 455;  // px

CameraIntrinsics camera() {
  CameraIntrinsics camera;
  camera.width = 752;
  camera.height = 480;
  camera.fx = camera.fy = kFocal;
  camera.cx = 375.5;
  camera.cy = 239.5;
  return camera;
}
constexpr std::uint64_t kOwnIds = 1000, kPeerIds = 5000;

Collaborator make_drone(const std::string& name, PlaceMode mode = PlaceMode::kCompact) {
  CollaboratorConfig config;
  config.agent = name;
  config.place_mode = mode;
  return Collaborator(config, visual_vocabulary(), camera());
}

Collaborator make_drone(const std::string& name, ExchangeMode exchange) {
  CollaboratorConfig config;
  config.agent = name;
  config.exchange = exchange;
  config.place_threshold = 0.1;
  config.recent_frames = 3;
  return Collaborator(config, visual_vocabulary(), camera());
}

Matrix6d pose_covariance() { return 1e-4 * Matrix6d::Identity(); }

// The drone takes one keyframe of the scene and knows the depths of all it sees.
PlaceAdvert look(Collaborator& drone, const Scene& scene, const Eigen::Isometry3d& T_world_cam,
                 double seconds, std::uint64_t first_id) {
  const TimeNs stamp_ns = nanoseconds(seconds);
  const auto seed = static_cast<unsigned>(first_id);
  drone.set_time(stamp_ns);
  return drone.add_keyframe(view(scene, T_world_cam, stamp_ns, first_id, {}, seed + 1), {},
                            T_world_cam, pose_covariance(),
                            depths(scene, T_world_cam, first_id, 0.003, seed));
}

// An image that is no keyframe.
PlaceAdvert glance(Collaborator& drone, const Scene& scene, const Eigen::Isometry3d& T_world_cam,
                   double seconds, std::uint64_t first_id) {
  const TimeNs stamp_ns = nanoseconds(seconds);
  const auto seed = static_cast<unsigned>(first_id);
  return drone.add_frame(view(scene, T_world_cam, stamp_ns, first_id, {}, seed + 1), {},
                         T_world_cam, pose_covariance(),
                         depths(scene, T_world_cam, first_id, 0.003, seed));
}

NoMatchReason reason_of(const std::variant<KeyframeMatch, NoMatch>& result) {
  const auto* none = std::get_if<NoMatch>(&result);
  EXPECT_NE(none, nullptr) << "matched, but should not have";
  return none ? none->reason : NoMatchReason::kMalformed;
}

// uav0 asks from 1.5 m aside of where uav1 looked at the same wall.
struct Team {
  explicit Team(PlaceMode mode = PlaceMode::kCompact)
      : uav0(make_drone("uav0", mode)), uav1(make_drone("uav1", mode)) {
    look(uav1, scene, looked_at, 1.0, kPeerIds);
    advert = look(uav0, scene, level_camera({0.5, 1.5, 0.3}, 0.1), 3.0, kOwnIds);
  }
  [[nodiscard]] PeerKeyframe ask() { return uav1.answer(advert).value(); }

  Scene scene = make_scene(80, {12, 0, 0}, 42);
  Eigen::Isometry3d looked_at = level_camera({0, 0, 0});
  Collaborator uav0, uav1;
  PlaceAdvert advert;
};

// Between the point that the peer means and the one that the own track is, m.
double distance_to_own_point(const Team& team, const LandmarkMatch& match) {
  const Eigen::Vector3d p_world =
      team.looked_at * (match.other_bearing.homogeneous() / match.inverse_depth).eval();
  return (p_world - team.scene[match.track_id - kOwnIds].p_world).norm();
}

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
  EXPECT_EQ(drone.report().revisits, 1);
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
