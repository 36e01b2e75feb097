// SPDX-License-Identifier: Apache-2.0
//
// A computer on a network, as all are that fly: ordinary drivers of it are heard where nothing may
// leave it, and nobody else. In network namespaces of their own; skipped where none can be made.
#include <gtest/gtest.h>
#include <sched.h>

#include <chrono>
#include <memory>
#include <string>
#include <vector>

#include "apps/drone_network.h"
#include "comms/datagram_socket.h"
#include "comms/onboard_link.h"
#include "tests/comms/cyclone_process.h"
#include "tests/comms/eventually.h"
#include "tests/comms/samples.h"

namespace covey {
namespace {

using std::chrono::milliseconds;

constexpr int kDomain = 0;
const std::string kOwnSettings;  // of Cyclone DDS: none

std::vector<std::string> driver(const std::string& where = "") {
  std::vector<std::string> command = {COVEY_ORDINARY_DRIVER, std::to_string(kDomain)};
  if (!where.empty()) command.push_back(where);
  return command;
}

NetworkModel two_computers() {
  NetworkModel model;
  model.drones = 2;
  return model;
}

class OnboardNetwork : public testing::Test {
 protected:
  void SetUp() override {
    if (const auto why = why_no_namespaces()) GTEST_SKIP() << *why;
    network_ = std::make_unique<DroneNetwork>(two_computers(), 7);
    go_to(0);
  }

  // What this thread starts from now on is on that computer.
  void go_to(std::size_t computer) {
    ASSERT_EQ(setns(network_->namespace_of(computer), CLONE_NEWNET), 0);
  }

  void expect_to_be_heard_by_and_to_hear(const std::vector<std::string>& command) {
    OnboardConfig config;
    config.domain = kDomain;
    OnboardLink drone(config, "world", "imu");
    CycloneClient sensors(command, kOwnSettings);
    EXPECT_TRUE(drone.next_image(kPatience));
    BodyMotion motion;
    motion.odometry = samples::odometry();
    EXPECT_TRUE(eventually([&] {
      drone.publish(motion);
      return sensors.next(milliseconds(20)).has_value();
    }));
    EXPECT_EQ(sensors.finish(), 0);
  }

  std::unique_ptr<DroneNetwork> network_;
};

TEST_F(OnboardNetwork, AnOrdinaryDriverIsHeardAndHears) {
  expect_to_be_heard_by_and_to_hear(driver());
}

TEST_F(OnboardNetwork, ADriverThatKeepsToTheLoopbackIsHeardAndHears) {
  expect_to_be_heard_by_and_to_hear(driver("localhost"));
}

TEST_F(OnboardNetwork, AnOrdinaryDriverOfAnotherVendorIsHeardAndHears) {
  if (std::string(COVEY_CYCLONE_SENSORS).empty()) GTEST_SKIP() << kNoCyclone;
  expect_to_be_heard_by_and_to_hear({COVEY_CYCLONE_SENSORS, std::to_string(kDomain)});
}

// One says to all that it is there, another calls the drone at each of its ports.
TEST_F(OnboardNetwork, NothingGoesToAnotherComputerAndNothingOfItIsTaken) {
  constexpr std::uint64_t kCalls = 5, kImages = 20;
  OnboardConfig config;
  config.domain = kDomain;
  OnboardLink drone(config, "world", "imu");
  go_to(1);
  CycloneClient ordinary(driver(), kOwnSettings);
  ASSERT_TRUE(eventually([&] { return network_->frames().counts()[1].delivered >= kCalls; }));
  EXPECT_EQ(network_->frames().counts()[0].frames_sent, 0U);
  CycloneClient caller(driver(drone_address(0)), kOwnSettings);
  go_to(0);

  config.loopback_only = false;
  const OnboardLink open(config, "world", "imu");
  BodyMotion motion;
  motion.odometry = samples::odometry();
  ASSERT_TRUE(eventually([&] {
    drone.publish(motion);
    return open.counts().images > kImages;
  }));
  EXPECT_EQ(drone.counts().images, 0U);
  for (CycloneClient* other : {&ordinary, &caller}) {
    EXPECT_FALSE(other->next(milliseconds(0)));
    EXPECT_EQ(other->finish(), 0);
  }
}

// Malformed packets of this computer are counted, those of another one are not even looked at.
TEST_F(OnboardNetwork, APacketFromAnotherComputerGetsNoFurther) {
  constexpr std::uint16_t kPort = 7410 + 2 * 32;  // onboard_participant.cpp
  constexpr std::uint64_t kPackets = 20;
  const Bytes packet = {1, 2, 3, 4};
  OnboardConfig config;
  config.domain = kDomain;
  const OnboardLink drone(config, "world", "imu");
  const DatagramSocket here("", 1 << 16);
  go_to(1);
  const DatagramSocket there("", 1 << 16);
  const auto send = [&](const DatagramSocket& socket) {
    return socket.send(packet.data(), packet.size(), drone_address(0), kPort);
  };
  for (std::uint64_t i = 0; i < kPackets; ++i) ASSERT_TRUE(send(there));
  ASSERT_TRUE(eventually([&] { return network_->frames().counts()[1].delivered == kPackets; }));
  ASSERT_TRUE(send(here));
  ASSERT_TRUE(eventually([&] { return drone.counts().malformed_packets > 0; }));
  EXPECT_EQ(drone.counts().malformed_packets, 1U);
}

}  // namespace
}  // namespace covey
