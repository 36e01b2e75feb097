// SPDX-License-Identifier: Apache-2.0
#include "comms/checks.h"

#include <gtest/gtest.h>

#include <functional>
#include <limits>
#include <string>

#include "tests/comms/samples.h"

namespace covey {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();

template <typename Message>
std::string problem_after(Message message, const std::function<void(Message&)>& damage) {
  damage(message);
  return problem_with(message).value_or("");
}
std::string advert_problem(const std::function<void(PlaceAdvert&)>& damage) {
  return problem_after<PlaceAdvert>(samples::advert(), damage);
}
std::string landmark_problem(const std::function<void(PeerLandmark&)>& damage) {
  return problem_after<PeerKeyframe>(samples::keyframe(),
                                     [&](auto& keyframe) { damage(keyframe.landmarks[17]); });
}
std::string filter_problem(const std::function<void(FilterSnapshot&)>& damage) {
  return problem_after<FullPeerKeyframe>(samples::full_keyframe(),
                                         [&](auto& message) { damage(message.filter); });
}
std::string odometry_problem(const std::function<void(Odometry&)>& damage) {
  return problem_after<Odometry>(samples::odometry(), damage);
}

std::string found_problem(const std::function<void(PeerKeyframe&)>& damage) {
  return problem_after<PeerKeyframe>(samples::found(), damage);
}

TEST(Checks, WhatWasFoundIsPlausibleAndComesAlone) {
  EXPECT_EQ(found_problem([](auto&) {}), "");
  EXPECT_EQ(found_problem([](auto& m) { m.landmarks.push_back(samples::landmark(1)); }),
            "what was found comes with landmarks");
  FullPeerKeyframe full = samples::full_keyframe();
  full.keyframe = samples::found();
  EXPECT_EQ(problem_with(full).value_or(""), "what was found comes with a whole filter");
  for (const double bad : {kNan, kInfinity, 1e6}) {
    EXPECT_EQ(found_problem([&](auto& m) { m.found->T_keyframe_cam.translation().z() = bad; }),
              "position not plausible");
    EXPECT_EQ(found_problem([&](auto& m) { m.found->log_depth_ratio = bad; }),
              "depth ratio not plausible");
  }
  EXPECT_EQ(found_problem([](auto& m) { m.found->T_keyframe_cam.linear() *= 2; }),
            "attitude is not a rotation");
  const std::string implausible =
      "covariance of what was found not positive definite or not plausible";
  for (const double bad : {kNan, 0.0, -1.0, 1e9}) {
    EXPECT_EQ(found_problem([&](auto& m) { m.found->covariance(6, 6) = bad; }), implausible);
  }
}

TEST(Checks, GoodMessagesHaveNoProblem) {
  EXPECT_EQ(problem_with(samples::advert()).value_or(""), "");
  EXPECT_EQ(problem_with(samples::keyframe()).value_or(""), "");
  EXPECT_EQ(problem_with(samples::full_keyframe()).value_or(""), "");
  EXPECT_EQ(problem_with(samples::full_keyframe("uav1", "")).value_or(""), "");  // for all
  EXPECT_EQ(problem_with(samples::status()).value_or(""), "");
  EXPECT_EQ(problem_with(samples::odometry()).value_or(""), "");
  EXPECT_EQ(problem_with(Odometry{}).value_or(""), "");  // before initialisation: no covariance yet
}

TEST(Checks, OnlyAWholeFilterMayBeForAll) {
  EXPECT_EQ(problem_with(samples::keyframe("uav1", "")).value_or(""),
            "receiver is not a drone's name");
  EXPECT_EQ(problem_with(samples::full_keyframe("uav1", "a/b")).value_or(""),
            "receiver is not a drone's name");
}

TEST(Checks, TheListsOfAFilterFitTogether) {
  const std::string misfit = "sizes in the filter do not fit together";
  EXPECT_EQ(filter_problem([](auto& f) { f.state.conservativeResize(f.state.size() - 1); }),
            misfit);
  EXPECT_EQ(filter_problem([](auto& f) { f.state.resize(0); }), misfit);
  EXPECT_EQ(filter_problem([](auto& f) { f.landmark_tracks.pop_back(); }), misfit);
  EXPECT_EQ(filter_problem([](auto& f) { f.landmark_anchors.push_back(0); }), misfit);
  EXPECT_EQ(filter_problem([](auto& f) {
              f.covariance =
                  Eigen::MatrixXd::Identity(f.covariance.rows() - 3, f.covariance.cols() - 3);
            }),
            misfit);
  EXPECT_EQ(filter_problem([](auto& f) {
              f.covariance =
                  Eigen::MatrixXd::Identity(f.covariance.rows() + 7, f.covariance.cols() + 7);
            }),
            "");  // its calibration is estimated
  EXPECT_EQ(filter_problem([](auto& f) { f = samples::filter(20, 41); }), "filter too large");
  EXPECT_EQ(filter_problem([](auto& f) { f.landmark_anchors[1] = 3; }),
            "landmark without an anchor");
}

TEST(Checks, TheNumbersOfAFilterArePlausible) {
  EXPECT_EQ(filter_problem([](auto& f) { f.stamp_ns = -1; }), "stamp not plausible");
  for (const double bad : {kNan, kInfinity, 1e7}) {
    EXPECT_EQ(filter_problem([&](auto& f) { f.state[2] = bad; }),
              "state of the filter not plausible");
  }
  for (const int at : {6, 19, 27, 41}) {
    EXPECT_EQ(filter_problem([&](auto& f) { f.state[at] += 0.5; }),
              "attitude is not a unit quaternion");
  }
  const std::string implausible = "covariance of the filter not plausible";
  EXPECT_EQ(filter_problem([](auto& f) { f.covariance(7, 7) = 0; }), implausible);
  EXPECT_EQ(filter_problem([](auto& f) { f.covariance(3, 8) = kNan; }), implausible);
  EXPECT_EQ(filter_problem([](auto& f) { f.covariance(3, 8) += 1e-6; }), implausible);
  EXPECT_EQ(filter_problem([](auto& f) { f.covariance.conservativeResize(39, 38); }),
            "covariance of the filter is not square");
}

TEST(Checks, NamesAreShortAndPlain) {
  EXPECT_TRUE(is_agent_name("uav0"));
  EXPECT_TRUE(is_agent_name("Red_Kite-12"));
  EXPECT_TRUE(is_agent_name(std::string(32, 'a')));
  EXPECT_FALSE(is_agent_name(""));
  EXPECT_FALSE(is_agent_name(std::string(33, 'a')));
  EXPECT_FALSE(is_agent_name("../uav0"));
  EXPECT_FALSE(is_agent_name("uav 0"));
  EXPECT_FALSE(is_agent_name("uav\n"));
  EXPECT_FALSE(is_agent_name(std::string("uav\0", 4)));
  EXPECT_FALSE(is_agent_name("dr\xc3\xb6hne"));
}

TEST(Checks, AdvertNeedsASenderAndAStamp) {
  EXPECT_EQ(advert_problem([](auto& a) { a.sender = ""; }), "sender is not a drone's name");
  EXPECT_EQ(advert_problem([](auto& a) { a.stamp_ns = -1; }), "stamp not plausible");
  EXPECT_EQ(advert_problem([](auto& a) { a.stamp_ns = std::numeric_limits<TimeNs>::max(); }),
            "stamp not plausible");
  EXPECT_EQ(advert_problem([](auto& a) { a.descriptor.clear(); }), "") << "a brief question";
  EXPECT_EQ(advert_problem([](auto& a) { a.descriptor.resize(4097); }),
            "place descriptor too long");
}

TEST(Checks, AdvertNeedsAPlausibleView) {
  for (const double x : {kNan, 1.1e5}) {
    EXPECT_EQ(advert_problem([&](auto& a) { a.view.T_world_cam.translation().x() = x; }),
              "position not plausible");
  }
  EXPECT_EQ(advert_problem([](auto& a) { a.view.T_world_cam.linear() *= 1.1; }),
            "attitude is not a rotation");
  for (const double depth : {kNan, 0.0, -3.0, 1e6}) {
    EXPECT_EQ(advert_problem([&](auto& a) { a.view.mean_depth = depth; }), "depth not plausible");
  }
  for (const double sigma : {kNan, -0.1, 1.1e9}) {
    EXPECT_EQ(advert_problem([&](auto& a) { a.view.sigma = sigma; }),
              "uncertainty of the view not plausible");
  }
}

TEST(Checks, KeyframeNeedsNamesAndABoundedSetOfLandmarks) {
  const auto problem = [](const std::function<void(PeerKeyframe&)>& damage) {
    return problem_after<PeerKeyframe>(samples::keyframe(), damage);
  };
  EXPECT_EQ(problem([](auto& k) { k.sender = "uav/0"; }), "sender is not a drone's name");
  EXPECT_EQ(problem([](auto& k) { k.receiver = ""; }), "receiver is not a drone's name");
  EXPECT_EQ(problem([](auto& k) { k.pose.stamp_ns = -5; }), "stamp not plausible");
  EXPECT_EQ(problem([](auto& k) { k.landmarks.resize(257); }), "too many landmarks");
  EXPECT_EQ(problem([](auto& k) { k.landmarks.clear(); }), "");
  EXPECT_EQ(problem([](auto& k) { k.before.stamp_ns = -5; }), "stamp not plausible");
  for (const double bad : {kNan, kInfinity, -1e-3, 1.0}) {
    EXPECT_EQ(problem([&](auto& k) { k.patch_spacing = bad; }), "patch spacing not plausible");
  }
}

TEST(Checks, KeyframePoseIsAPose) {
  const auto problem = [](const std::function<void(KeyframePose&)>& damage) {
    return problem_after<PeerKeyframe>(samples::keyframe(), [&](auto& k) { damage(k.pose); });
  };
  for (const double bad : {kNan, kInfinity, -kInfinity, 1e30}) {
    EXPECT_EQ(problem([&](auto& p) { p.T_world_cam.translation().z() = bad; }),
              "position not plausible");
    EXPECT_EQ(problem([&](auto& p) { p.T_world_cam.linear()(1, 2) = bad; }),
              "attitude is not a rotation");
  }
  const std::string complaint = "pose covariance not positive definite or not plausible";
  EXPECT_EQ(problem([](auto& p) { p.covariance(2, 2) = -1e-4; }), complaint);
  EXPECT_EQ(problem([](auto& p) { p.covariance(2, 2) = kNan; }), complaint);
  EXPECT_EQ(problem([](auto& p) { p.covariance.setZero(); }), complaint);
  // Correlations above one: every diagonal is fine.
  EXPECT_EQ(problem([](auto& p) { p.covariance(0, 1) = 2.0; }), complaint);
}

TEST(Checks, LandmarkNumbersAreFiniteAndPlausible) {
  for (const double bad : {kNan, kInfinity, -kInfinity, 1e30}) {
    EXPECT_EQ(landmark_problem([&](auto& l) { l.bearing.x() = bad; }), "bearing not plausible");
    EXPECT_EQ(landmark_problem([&](auto& l) { l.inverse_depth = bad; }), "depth not plausible");
    EXPECT_EQ(landmark_problem([&](auto& l) { l.inverse_depth_sigma = bad; }),
              "depth uncertainty not plausible");
  }
  EXPECT_EQ(landmark_problem([](auto& l) { l.inverse_depth = 0; }), "depth not plausible");
  EXPECT_EQ(landmark_problem([](auto& l) { l.inverse_depth = -1; }), "depth not plausible");
  EXPECT_EQ(landmark_problem([](auto& l) { l.inverse_depth_sigma = -1e-6; }),
            "depth uncertainty not plausible");
  EXPECT_EQ(landmark_problem([](auto& l) { l.inverse_depth_sigma = 1.01 * l.inverse_depth; }),
            "depth uncertainty not plausible");
}

TEST(Checks, StatusIsOneOfTheFour) {
  const auto problem = problem_after<AgentStatus>(
      samples::status(), [](auto& s) { s.status = static_cast<FilterStatus>(4); });
  EXPECT_EQ(problem, "unknown filter status");
}

TEST(Checks, OdometryHasAUnitQuaternion) {
  const std::string complaint = "attitude is not a unit quaternion";
  EXPECT_EQ(odometry_problem([](auto& o) { o.pose.q_world_imu.coeffs().setZero(); }), complaint);
  EXPECT_EQ(odometry_problem([](auto& o) { o.pose.q_world_imu.coeffs() *= 1.01; }), complaint);
  EXPECT_EQ(odometry_problem([](auto& o) { o.pose.q_world_imu.w() = kNan; }), complaint);
}

TEST(Checks, OdometryNumbersAreFiniteAndPlausible) {
  for (const double bad : {kNan, kInfinity, -1e9}) {
    EXPECT_NE(odometry_problem([&](auto& o) { o.pose.p_world_imu.y() = bad; }), "");
    EXPECT_NE(odometry_problem([&](auto& o) { o.v_world_imu.x() = bad; }), "");
    EXPECT_NE(odometry_problem([&](auto& o) { o.gyro_bias.z() = bad; }), "");
    EXPECT_NE(odometry_problem([&](auto& o) { o.accel_bias.z() = bad; }), "");
    EXPECT_NE(odometry_problem([&](auto& o) { o.pose_covariance(5, 5) = bad; }), "");
    EXPECT_NE(odometry_problem([&](auto& o) { o.pose_covariance(0, 5) = bad; }), "");
  }
  EXPECT_NE(odometry_problem([](auto& o) { o.pose_covariance.setZero(); }), "");
}

}  // namespace
}  // namespace covey
