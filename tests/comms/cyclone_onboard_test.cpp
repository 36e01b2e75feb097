// SPDX-License-Identifier: Apache-2.0
//
// A drone and another vendor's programs aboard it: Cyclone DDS in a process of its own
// (cyclone_sensors.cpp).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "comms/onboard_link.h"
#include "tests/comms/cyclone_process.h"
#include "tests/comms/samples.h"

namespace covey {
namespace {

using nlohmann::json;
using std::chrono::milliseconds;
using std::chrono::steady_clock;
using testing::ElementsAre;
using testing::HasSubstr;

class CycloneOnboard : public testing::Test {
 protected:
  void SetUp() override {
    if (std::string(COVEY_CYCLONE_SENSORS).empty()) GTEST_SKIP() << kNoCyclone;
    config_.domain = team_config("uav0").domain;
    config_.px4_topic = "fmu/in/vehicle_visual_odometry";
  }
  [[nodiscard]] std::vector<std::string> command() const {
    return {COVEY_CYCLONE_SENSORS, std::to_string(config_.domain)};
  }
  OnboardConfig config_;
};

TEST_F(CycloneOnboard, ItsCameraAndImuAreHeard) {
  OnboardLink drone(config_, "world", "imu");
  CycloneClient sensors(command());
  const auto image = drone.next_image(kPatience);
  ASSERT_TRUE(image);
  EXPECT_EQ(image->width, 320);
  EXPECT_EQ(image->height, 240);
  ASSERT_EQ(image->pixels.size(), 320U * 240U);
  for (std::size_t i = 0; i < image->pixels.size(); ++i)
    ASSERT_EQ(image->pixels[i], static_cast<std::uint8_t>(i));
  EXPECT_GT(image->stamp_ns, 5'000'000'000);
  ASSERT_TRUE(drone.wait_for_imu(image->stamp_ns, kPatience));
  const ImuSample sample = drone.take_imu().front();
  EXPECT_EQ(sample.gyro_imu, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(sample.accel_imu, Eigen::Vector3d(1, 2, 9.81));
  EXPECT_EQ(drone.counts().refused, 0U);
  EXPECT_EQ(sensors.finish(), 0);
}

TEST_F(CycloneOnboard, ItHearsWhereTheDroneIs) {
  OnboardLink drone(config_, "world", "uav0/imu");
  CycloneClient client(command());
  BodyMotion motion;
  motion.odometry = samples::odometry();
  motion.odometry.stamp_ns = 7'000'000'123'000;
  motion.gyro_imu = {0.5, 0.6, 0.7};
  motion.restarts = 4;
  json nav, px4;
  const auto deadline = steady_clock::now() + kPatience;
  while ((nav.empty() || px4.empty()) && steady_clock::now() < deadline) {
    drone.publish(motion);
    while (const auto told = client.next(milliseconds(20)))
      ((*told)["topic"] == "nav" ? nav : px4) = *told;
  }
  ASSERT_FALSE(nav.empty());
  ASSERT_FALSE(px4.empty());
  const Eigen::Vector3d& p = motion.odometry.pose.p_world_imu;
  EXPECT_EQ(nav["sec"], 7000);
  EXPECT_EQ(nav["nanosec"], 123'000);
  EXPECT_EQ(nav["frame"], "world");
  EXPECT_EQ(nav["child_frame"], "uav0/imu");
  EXPECT_THAT(nav["position"], ElementsAre(p.x(), p.y(), p.z()));
  EXPECT_GT(nav["variance_yaw"], 0);
  EXPECT_EQ(nav["angular_z"], 0.7);
  EXPECT_EQ(px4["timestamp"], 7'000'000'123);
  EXPECT_EQ(px4["pose_frame"], 2);
  EXPECT_NEAR(px4["position"][1], -p.y(), 1e-5);
  EXPECT_EQ(px4["reset_counter"], 4);
  EXPECT_EQ(px4["quality"], 100);
  EXPECT_EQ(client.finish(), 0);
}

TEST_F(CycloneOnboard, WhoAsksForEverySampleIsToldWhyNoneComes) {
  config_.reliable = true;
  OnboardLink drone(config_, "world", "imu");
  CycloneClient sensors(command());
  const auto deadline = steady_clock::now() + kPatience;
  while (drone.counts().refused < 2 && steady_clock::now() < deadline)
    EXPECT_FALSE(drone.next_image(milliseconds(20)));
  EXPECT_THAT(drone.counts().last_refusal, HasSubstr("best effort alone, and onboard.reliable"));
  EXPECT_EQ(sensors.finish(), 0);
}

}  // namespace
}  // namespace covey
