// SPDX-License-Identifier: Apache-2.0
//
// What a peer has seen is looked for where its pose says it must be: views too different for
// descriptors, which are drawn at random here, match all the same.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "estimator/so3.h"
#include "frontend/collaborator.h"
#include "frontend/vocabulary_visual.h"
#include "synthetic_places.h"
#include "synthetic_view.h"

namespace covey {
namespace {

using testing::random_descriptor;
using testing_view::CameraPose;
using testing_view::SlantedPlane;
using testing_view::small_camera;

Eigen::Isometry3d to_isometry(const CameraPose& pose) {
  Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
  T_world_cam.linear() = pose.R_world_cam;
  T_world_cam.translation() = pose.p_world_cam;
  return T_world_cam;
}

Collaborator make_drone(const std::string& name, bool common_start = true) {
  CollaboratorConfig config;
  config.agent = name;
  config.matching.common_start = common_start;
  config.place_mode = PlaceMode::kPaper;
  return Collaborator(config, visual_vocabulary(), small_camera());
}

// A keyframe of an image of the wall, with points on a grid whose depths are known.
PlaceAdvert look(Collaborator& drone, const SlantedPlane& wall, const cv::Mat& image,
                 const CameraPose& pose, const Eigen::Isometry3d& T_world_cam, unsigned seed) {
  std::mt19937 random(seed);
  TrackedFrame frame;
  frame.stamp_ns = nanoseconds(seed);
  std::vector<TrackDepth> depths;
  for (int column = -5; column <= 5; ++column) {
    for (int row = -4; row <= 4; ++row) {
      TrackedFeature feature;
      feature.track_id = frame.features.size();
      feature.bearing = {0.1 * column, 0.09 * row};
      feature.described = true;
      feature.descriptor = random_descriptor(random);
      const Eigen::Vector3d p_cam = to_isometry(pose).inverse() * wall.point(pose, feature.bearing);
      depths.push_back({feature.track_id, 1 / p_cam.z(), 0.01 / p_cam.z()});
      frame.features.push_back(feature);
    }
  }
  drone.set_time(frame.stamp_ns);
  return drone.add_keyframe(frame, build_pyramid(image, 3), T_world_cam,
                            1e-4 * Matrix6d::Identity(), depths);
}

PlaceAdvert look(Collaborator& drone, const SlantedPlane& wall, const CameraPose& pose,
                 const Eigen::Isometry3d& T_world_cam, unsigned seed) {
  return look(drone, wall, wall.image(pose), pose, T_world_cam, seed);
}

CameraPose aside() {
  CameraPose pose;
  pose.p_world_cam << 1.1, -0.3, 0.4;
  pose.R_world_cam = exp_so3({0.05, -0.2, 0.1});
  return pose;
}

// uav1 looks straight at its wall, uav0 at its own from aside; each has its own world.
std::variant<KeyframeMatch, NoMatch> ask(
    Collaborator& uav0, const SlantedPlane& own_wall, const SlantedPlane& peers_wall,
    const Eigen::Isometry3d& T_own_peer = {Eigen::Isometry3d::Identity()}, unsigned second = 1) {
  Collaborator uav1 = make_drone("uav1");
  look(uav1, peers_wall, {}, T_own_peer.inverse(), second);
  const PlaceAdvert advert = look(uav0, own_wall, aside(), to_isometry(aside()), second + 1);
  PeerKeyframe answer = uav1.announcement().value();
  answer.receiver = "uav0";
  answer.request_keyframe_id = advert.keyframe_id;
  return uav0.match(answer);
}

Eigen::Isometry3d far_world() {
  Eigen::Isometry3d T_own_peer = Eigen::Isometry3d::Identity();
  T_own_peer.linear() = exp_so3({0, 0, 0.08});
  T_own_peer.translation() << 1.5, -2, 0.7;
  return T_own_peer;
}

void expect_found(const std::variant<KeyframeMatch, NoMatch>& result) {
  const auto* match = std::get_if<KeyframeMatch>(&result);
  ASSERT_NE(match, nullptr) << to_string(std::get<NoMatch>(result).reason);
  EXPECT_GT(match->aligned.size(), 30u);
  const Eigen::Isometry3d error = to_isometry(aside()).inverse() * match->T_other_own;
  EXPECT_LT(error.translation().norm(), 0.02);
  EXPECT_LT(log_so3(error.linear()).norm(), 0.005);
}

TEST(InPlaceMatching, FindsWhatDescriptorsCannot) {
  const SlantedPlane wall(small_camera());
  Collaborator uav0 = make_drone("uav0");
  expect_found(ask(uav0, wall, wall));
}

// uav1 answers without descriptors; where its world has moved, nothing is found, and the next
// question carries corners again.
TEST(InPlaceMatching, ABriefAnswerIsFoundInItsPlaceOrNotAtAll) {
  const SlantedPlane wall(small_camera());
  const auto found = [&](const Eigen::Isometry3d& T_own_peer) {
    Collaborator uav0 = make_drone("uav0"), uav1 = make_drone("uav1");
    look(uav1, wall, {}, T_own_peer.inverse(), 1);
    PlaceAdvert advert = look(uav0, wall, aside(), to_isometry(aside()), 2);
    (void)uav0.question(advert);
    PeerKeyframe answer = uav1.announcement().value();
    answer.receiver = "uav0";
    answer.request_keyframe_id = advert.keyframe_id;
    answer.described = false;
    for (PeerLandmark& landmark : answer.landmarks) landmark.descriptor = {};
    const auto result = uav0.match(answer);
    const auto* match = std::get_if<KeyframeMatch>(&result);
    EXPECT_NE(uav0.question(advert).descriptor.empty(), match == nullptr);
    if (match != nullptr) {
      expect_found(result);
      EXPECT_FALSE(match->matches.empty()) << "own corners that happen to lie there";
      for (const LandmarkMatch& pair : match->matches) EXPECT_GT(pair.own_inverse_depth, 0);
    }
    return match != nullptr;
  };
  EXPECT_TRUE(found(Eigen::Isometry3d::Identity()));
  EXPECT_FALSE(found(far_world()));
}

TEST(InPlaceMatching, MessagesOfThePaperHaveNoPictures) {
  const SlantedPlane wall(small_camera());
  const auto told = [&](ExchangeMode exchange, bool pictures_always) {
    CollaboratorConfig config;
    config.exchange = exchange;
    config.pictures_always = pictures_always;
    Collaborator drone(config, visual_vocabulary(), small_camera());
    look(drone, wall, {}, Eigen::Isometry3d::Identity(), 1);
    return drone.announcement().value();
  };
  const auto has_picture = [](const PeerLandmark& landmark) {
    return landmark.patch != LandmarkPatch{};
  };
  for (const ExchangeMode exchange : {ExchangeMode::kPaper, ExchangeMode::kNaive}) {
    const PeerKeyframe as_published = told(exchange, false), with_ours = told(exchange, true);
    EXPECT_EQ(as_published.patch_spacing, 0);
    EXPECT_FALSE(
        std::any_of(as_published.landmarks.begin(), as_published.landmarks.end(), has_picture));
    EXPECT_GT(with_ours.patch_spacing, 0);
    EXPECT_TRUE(std::any_of(with_ours.landmarks.begin(), with_ours.landmarks.end(), has_picture));
    EXPECT_EQ(as_published.landmarks.size(), with_ours.landmarks.size());
  }
  EXPECT_GT(told(ExchangeMode::kCompact, false).patch_spacing, 0);
}

TEST(InPlaceMatching, WithoutACommonStartNothingIsExpectedUntilTheWorldIsKnown) {
  const SlantedPlane wall(small_camera());
  Collaborator uav0 = make_drone("uav0", false);
  EXPECT_TRUE(std::holds_alternative<NoMatch>(ask(uav0, wall, wall, far_world())));
  uav0.know_world("uav1", far_world());
  expect_found(ask(uav0, wall, wall, far_world()));
}

TEST(InPlaceMatching, UntilThenItIsLookedForWhereItIsSupposedToBe) {
  const SlantedPlane wall(small_camera());
  Collaborator uav0 = make_drone("uav0", false);
  uav0.suppose_world("uav1", far_world());
  expect_found(ask(uav0, wall, wall, far_world()));
  uav0.suppose_world("uav1", Eigen::Isometry3d::Identity());
  EXPECT_TRUE(std::holds_alternative<NoMatch>(ask(uav0, wall, wall, far_world())));
  uav0.know_world("uav1", far_world());
  expect_found(ask(uav0, wall, wall, far_world()));
  uav0.suppose_world("uav1", Eigen::Isometry3d::Identity());
  expect_found(ask(uav0, wall, wall, far_world()));
}

// By how much worlds may differ counts from where they are known to lie: two odometries that have
// drifted far apart, or started at a wrong heading, do so by more than strangers may.
TEST(InPlaceMatching, AWorldThatIsKnownMayLieAnywhere) {
  const SlantedPlane wall(small_camera());
  Eigen::Isometry3d known = far_world();
  known.linear() = exp_so3({0.01, 0, 0.3});
  known.translation().x() += 20;
  Collaborator uav0 = make_drone("uav0");
  EXPECT_TRUE(std::holds_alternative<NoMatch>(ask(uav0, wall, wall, known)));
  uav0.know_world("uav1", known);
  expect_found(ask(uav0, wall, wall, known));
}

// What is remembered of a peer stands where its world was taken to be.
TEST(InPlaceMatching, WhatIsRememberedMovesWithAWorldThatWasWrong) {
  const SlantedPlane wall(small_camera());
  Eigen::Isometry3d wrong = far_world();
  wrong.translation().y() += 40;
  Collaborator uav0 = make_drone("uav0", false);
  uav0.know_world("uav1", wrong);
  EXPECT_TRUE(std::holds_alternative<NoMatch>(ask(uav0, wall, wall, far_world())));
  const auto revisited = [&](unsigned seed) {
    look(uav0, wall, aside(), to_isometry(aside()), seed);
    return uav0.revisit().size();
  };
  EXPECT_EQ(revisited(9), 0u);
  uav0.know_world("uav1", far_world());
  EXPECT_EQ(revisited(10), 0u);
  uav0.place_anew("uav1");
  EXPECT_EQ(revisited(11), 1u);
}

TEST(InPlaceMatching, TellsFromHowFarAsideThePlaceIsKnownAgain) {
  const SlantedPlane wall(small_camera());
  const double guess = ViewpointTolerance().tolerance();
  Collaborator uav0 = make_drone("uav0"), lost = make_drone("uav0");
  expect_found(ask(uav0, wall, wall));
  const double told = uav0.tolerance().tolerance();
  EXPECT_NE(told, guess);

  look(uav0, wall, aside(), to_isometry(aside()), 9);
  ASSERT_EQ(uav0.revisit().size(), 1u);
  EXPECT_NE(uav0.tolerance().tolerance(), told) << "what it remembers teaches as well";

  (void)ask(lost, wall, SlantedPlane(small_camera(), 100));
  EXPECT_EQ(lost.tolerance().tolerance(), guess) << "another wall tells nothing";
}

TEST(InPlaceMatching, WhatAPeerToldBeforeItStartedAnewIsNotLookedForAgain) {
  const SlantedPlane wall(small_camera());
  Collaborator uav0 = make_drone("uav0"), uav1 = make_drone("uav1");
  expect_found(ask(uav0, wall, wall));
  uav0.know_world("uav1", Eigen::Isometry3d::Identity());
  PlaceAdvert advert = look(uav1, wall, {}, Eigen::Isometry3d::Identity(), 3);
  for (const auto& [keyframe_id, remembered] :
       {std::pair(5, 1), std::pair(6, 1), std::pair(2, 0)}) {
    advert.keyframe_id = static_cast<std::uint64_t>(keyframe_id);
    (void)uav0.answer(advert);
    look(uav0, wall, aside(), to_isometry(aside()), static_cast<unsigned>(keyframe_id) + 20);
    EXPECT_EQ(uav0.revisit().size(), static_cast<std::size_t>(remembered)) << keyframe_id;
  }
}

TEST(InPlaceMatching, WhatAPeerTellsAfterItStartedAnewTakesThePlaceOfWhatItTold) {
  const SlantedPlane wall(small_camera());
  Collaborator uav0 = make_drone("uav0");
  expect_found(ask(uav0, wall, wall));
  expect_found(ask(uav0, wall, wall, Eigen::Isometry3d::Identity(), 11));  // its first one again
  look(uav0, wall, aside(), to_isometry(aside()), 14);
  const std::vector<KeyframeMatch> matches = uav0.revisit();
  ASSERT_EQ(matches.size(), 1u);
  EXPECT_EQ(matches[0].other.stamp_ns, nanoseconds(11));
}

TEST(InPlaceMatching, AnotherWallIsNotTheSame) {
  const SlantedPlane wall(small_camera());
  for (int seed = 100; seed < 110; ++seed) {
    Collaborator uav0 = make_drone("uav0");
    EXPECT_TRUE(
        std::holds_alternative<NoMatch>(ask(uav0, wall, SlantedPlane(small_camera(), seed))));
  }
}

// Both look straight at their walls, whose corners have the same descriptors. Left of `border` px
// the walls are one.
std::variant<KeyframeMatch, NoMatch> match_walls_alike_until(int border, Collaborator& uav0) {
  const SlantedPlane wall(small_camera()), another(small_camera(), 100);
  cv::Mat half = another.image({});
  wall.image({}).colRange(0, border).copyTo(half.colRange(0, border));
  Collaborator uav1 = make_drone("uav1");
  look(uav1, wall, {}, far_world().inverse(), 7);
  const PlaceAdvert advert = look(uav0, wall, half, {}, Eigen::Isometry3d::Identity(), 7);
  PeerKeyframe answer = uav1.announcement().value();
  answer.receiver = "uav0";
  answer.request_keyframe_id = advert.keyframe_id;
  return uav0.match(answer);
}

TEST(InPlaceMatching, APlaceThatHasOnlyHalfInCommonIsTakenForAnotherWhileWorldsAreUnknown) {
  const int width = small_camera().width;
  Collaborator stranger = make_drone("uav0", false), aliased = make_drone("uav0", false),
               acquainted = make_drone("uav0", false);
  EXPECT_TRUE(std::holds_alternative<KeyframeMatch>(match_walls_alike_until(width, stranger)));
  const auto refused = match_walls_alike_until(width / 2, aliased);
  ASSERT_TRUE(std::holds_alternative<NoMatch>(refused));
  EXPECT_EQ(std::get<NoMatch>(refused).reason, NoMatchReason::kTooFewFound);
  acquainted.know_world("uav1", far_world());
  EXPECT_TRUE(
      std::holds_alternative<KeyframeMatch>(match_walls_alike_until(width / 2, acquainted)));
}

TEST(InPlaceMatching, APeerInAnotherPlaceThanItSaysIsNotBelieved) {
  const SlantedPlane wall(small_camera());
  Eigen::Isometry3d wrong = Eigen::Isometry3d::Identity();
  wrong.translation().x() = 0.6;  // 30 px on the wall
  Collaborator uav0 = make_drone("uav0");
  EXPECT_TRUE(std::holds_alternative<NoMatch>(ask(uav0, wall, wall, wrong)));
}

}  // namespace
}  // namespace covey
