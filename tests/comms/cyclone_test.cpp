// SPDX-License-Identifier: Apache-2.0
//
// Drones and another vendor's client: Cyclone DDS in a process of its own (cyclone_client.cpp).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <functional>

#include "tests/comms/cyclone_process.h"
#include "tests/comms/samples.h"

namespace covey {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

class Cyclone : public testing::Test {
 protected:
  void SetUp() override {
    if (std::string(COVEY_CYCLONE_CLIENT).empty()) GTEST_SKIP() << kNoCyclone;
  }

  // What the client hears of a topic. Drones say it until then: who has just been found may miss
  // the first.
  json heard(CycloneClient& client, const std::string& topic, const std::function<void()>& say) {
    const auto deadline = steady_clock::now() + kPatience;
    while (steady_clock::now() < deadline) {
      say();
      while (const auto told = client.next(milliseconds(20)))
        if ((*told)["topic"] == topic) return *told;
    }
    return json::object();
  }
};

std::array<double, 3> array_of(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

std::array<double, 4> array_of(const Eigen::Quaterniond& q) { return {q.x(), q.y(), q.z(), q.w()}; }

TEST_F(Cyclone, ReadsWhatADroneSays) {
  PeerLink drone(team_config("uav0"));
  CycloneClient client(team_config("uav0"), "ground");

  const PlaceAdvert advert = samples::advert("uav0");
  const json request = heard(client, "request", [&] { drone.send(advert); });
  EXPECT_EQ(request["version"], kWireVersion);
  EXPECT_EQ(request["sender"], "uav0");
  EXPECT_EQ(request["keyframe_id"], advert.keyframe_id);
  EXPECT_EQ(request["stamp_ns"], advert.stamp_ns);
  EXPECT_EQ(request["vocabulary_hash"], advert.vocabulary_hash);
  EXPECT_EQ(request["p_world_cam"], array_of(advert.view.T_world_cam.translation()));
  EXPECT_EQ(request["mean_depth"], advert.view.mean_depth);
  EXPECT_EQ(request["view_sigma"], advert.view.sigma);
  EXPECT_EQ(request["descriptor"], advert.descriptor);

  const Odometry odometry = samples::odometry();
  const json told = heard(client, "odometry", [&] { drone.publish(odometry); });
  EXPECT_EQ(told["agent"], "uav0");
  EXPECT_EQ(told["stamp_ns"], odometry.stamp_ns);
  EXPECT_EQ(told["filter_status"], 1);
  EXPECT_EQ(told["p_world_imu"], array_of(odometry.pose.p_world_imu));
  EXPECT_EQ(told["q_world_imu_xyzw"], array_of(odometry.pose.q_world_imu));
  EXPECT_EQ(told["v_world_imu"], array_of(odometry.v_world_imu));
  EXPECT_EQ(told["gyro_bias"], array_of(odometry.gyro_bias));
  EXPECT_EQ(told["accel_bias"], array_of(odometry.accel_bias));
  EXPECT_NEAR(told["pose_covariance"][0], odometry.pose_covariance(0, 0), 1e-9);
  EXPECT_NEAR(told["pose_covariance"][20], odometry.pose_covariance(5, 5), 1e-9);
  EXPECT_EQ(client.finish(), 0);
}

TEST_F(Cyclone, ComesLateAndIsToldEachDronesLastStatus) {
  PeerLink first(team_config("uav0")), second(team_config("uav1"));
  const AgentStatus status = samples::status("uav0", 30);
  ASSERT_TRUE(first.publish(status));
  ASSERT_TRUE(second.publish(samples::status("uav1", 31)));
  ASSERT_TRUE(first.wait_for_peers({"uav1"}, kPatience));
  CycloneClient client(team_config("uav0"), "ground");
  json by_drone;
  while (by_drone.size() < 2) {
    const auto told = client.next(kPatience);
    ASSERT_TRUE(told.has_value());
    if ((*told)["topic"] == "status") by_drone[(*told)["agent"]] = *told;
  }
  EXPECT_EQ(by_drone["uav0"]["version"], kWireVersion);
  EXPECT_EQ(by_drone["uav0"]["stamp_ns"], status.stamp_ns);
  EXPECT_EQ(by_drone["uav0"]["filter_status"], 1);
  EXPECT_EQ(by_drone["uav0"]["frames"], 30);
  EXPECT_EQ(by_drone["uav0"]["tracks"], status.tracks);
  EXPECT_EQ(by_drone["uav0"]["keyframes"], status.keyframes);
  EXPECT_EQ(by_drone["uav0"]["hears"], 1);
  EXPECT_LE(by_drone["uav0"]["sent_ns"], wall_clock_ns());
  EXPECT_EQ(by_drone["uav1"]["frames"], 31);
}

// Of a size that travels in fragments, both ways.
TEST_F(Cyclone, IsAnsweredAlone) {
  PeerLink asked(team_config("uav0")), bystander(team_config("uav1"));
  ASSERT_TRUE(asked.wait_for_peers({"uav1"}, kPatience));
  CycloneClient client(team_config("uav0"), "ground");
  const PeerKeyframe answer = samples::keyframe("uav0", "ground", 95);
  std::optional<PlaceAdvert> question;
  const json told = heard(client, "message", [&] {
    asked.send(samples::advert("uav0", 7));
    for (const Inbound& inbound : asked.take())
      if (const auto* advert = std::get_if<PlaceAdvert>(&inbound)) question = *advert;
    if (question) asked.send(answer);
  });
  ASSERT_TRUE(question.has_value());
  EXPECT_EQ(question->sender, "ground");
  EXPECT_EQ(question->descriptor, samples::advert().descriptor);

  EXPECT_EQ(told["sender"], "uav0");
  EXPECT_EQ(told["receiver"], "ground");
  EXPECT_EQ(told["request_keyframe_id"], answer.request_keyframe_id);
  EXPECT_EQ(told["keyframe"]["stamp_ns"], answer.pose.stamp_ns);
  EXPECT_EQ(told["keyframe"]["p_world_cam"], array_of(answer.pose.T_world_cam.translation()));
  EXPECT_EQ(told["before"][0]["keyframe_id"], answer.before.keyframe_id);
  EXPECT_EQ(told["descriptors"], 8 * 95);
  EXPECT_EQ(told["bearings"], 2 * 95);
  EXPECT_EQ(told["inverse_depths"], 95);
  EXPECT_EQ(told["depth_sigmas"], 95);
  EXPECT_EQ(told["patches"], 8 * 95);

  EXPECT_GE(asked.statistics().messages_sent_to["ground"], 1U);
  EXPECT_TRUE(asked.flush(kPatience));
  EXPECT_EQ(bystander.arrived().messages, 0U);
  EXPECT_THAT(bystander.statistics().rejected, testing::IsEmpty());
  EXPECT_THAT(asked.statistics().rejected, testing::IsEmpty());
}

}  // namespace
}  // namespace covey
