// SPDX-License-Identifier: Apache-2.0
//
// A drone's sensors and its autopilot on the bus aboard, all in this process and on 127.0.0.1.
#include "comms/onboard_link.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <condition_variable>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <memory>
#include <mutex>
#include <vector>

#include "comms/byte_type.h"
#include "comms/datagram_socket.h"
#include "comms/dds_owners.h"
#include "comms/onboard_participant.h"
#include "comms/onboard_topics.h"
#include "comms/qos.h"
#include "comms/sensor_player.h"
#include "tests/comms/eventually.h"
#include "tests/comms/samples.h"
#include "tests/comms/team_config.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using std::chrono::milliseconds;
using testing::HasSubstr;
using testing::ThrowsMessage;

OnboardConfig onboard_config() {
  OnboardConfig config;
  config.domain = team_config("uav0").domain;
  config.reliable = true;
  config.px4_topic = "/fmu/in/vehicle_visual_odometry";
  return config;
}

CameraImage image(TimeNs stamp_ns) {
  return {stamp_ns, 752, 480, 1, std::vector<std::uint8_t>(std::size_t{752} * 480, 77)};
}

void play_imu(SensorPlayer& player, const std::vector<TimeNs>& stamps) {
  for (const TimeNs stamp_ns : stamps)
    EXPECT_TRUE(player.play(ImuSample{stamp_ns, {0.1, 0.2, 0.3}, {0, 0, 9.81}}));
}

TEST(OnboardLink, HearsEveryImageAndSampleInOrder) {
  OnboardConfig config = onboard_config();
  config.image_queue = 100;
  OnboardLink drone(config, "world", "imu");
  SensorPlayer player(config);
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  for (TimeNs i = 1; i <= 20; ++i) {
    EXPECT_TRUE(player.play(ImuSample{i * 1000, {0.1, 0.2, 0.3}, {0, 0, 9.81}}));
    EXPECT_TRUE(player.play(image(i * 1000)));
  }
  EXPECT_TRUE(drone.wait_for_imu(19'999, kPatience));
  EXPECT_FALSE(drone.wait_for_imu(20'000, milliseconds(1)));
  const std::vector<ImuSample> samples = drone.take_imu();
  ASSERT_EQ(samples.size(), 20U);
  for (TimeNs i = 1; i <= 20; ++i) {
    EXPECT_EQ(samples[static_cast<std::size_t>(i) - 1].stamp_ns, i * 1000);
    const auto heard = drone.next_image(kPatience);
    ASSERT_TRUE(heard);
    EXPECT_EQ(heard->stamp_ns, i * 1000);
    EXPECT_EQ(heard->pixels, image(0).pixels);
  }
  EXPECT_EQ(drone.counts().images, 20U);
  EXPECT_EQ(drone.counts().images_dropped, 0U);
}

// Fast DDS looks at so many ports of 127.0.0.1 as it is told to.
TEST(OnboardLink, HearsADriverAmongManyPrograms) {
  constexpr int kPrograms = 24;
  std::vector<std::unique_ptr<OnboardParticipant>> others;
  others.reserve(kPrograms);
  for (int i = 0; i < kPrograms; ++i)
    others.push_back(
        std::make_unique<OnboardParticipant>(OnboardNetwork{onboard_config().domain, true}));
  const OnboardLink drone(onboard_config(), "world", "imu");
  const SensorPlayer player(onboard_config());
  EXPECT_TRUE(eventually([&] { return player.is_heard(); }));
}

TEST(OnboardLink, HearsTheAutopilotsImu) {
  OnboardConfig config = onboard_config();
  config.imu_message = ImuMessage::kPx4;
  config.imu_topic = "fmu/out/sensor_combined";
  OnboardLink drone(config, "world", "imu");
  SensorPlayer player(config);
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  play_imu(player, {3000, 4000, 5000});
  ASSERT_TRUE(drone.wait_for_imu(4999, kPatience));
  EXPECT_NEAR(drone.take_imu().front().accel_imu.z(), 9.81, 1e-5);
}

TEST(OnboardLink, OfImagesThatWaitTheOldestIsDropped) {
  OnboardConfig config = onboard_config();
  config.image_queue = 2;
  OnboardLink drone(config, "world", "imu");
  SensorPlayer player(config);
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  for (TimeNs i = 1; i <= 5; ++i) player.play(image(i));
  ASSERT_TRUE(eventually([&] { return drone.counts().images == 5; }));
  EXPECT_EQ(drone.counts().images_dropped, 3U);
  EXPECT_EQ(drone.next_image(kPatience)->stamp_ns, 4);
  EXPECT_EQ(drone.next_image(kPatience)->stamp_ns, 5);
  EXPECT_FALSE(drone.next_image(milliseconds(1)));
}

TEST(OnboardLink, OfSamplesThatWaitTheOldestIsDropped) {
  OnboardConfig config = onboard_config();
  config.imu_queue = 3;
  OnboardLink drone(config, "world", "imu");
  SensorPlayer player(config);
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  play_imu(player, {1000, 2000, 3000, 4000, 5000});
  ASSERT_TRUE(drone.wait_for_imu(4999, kPatience));
  EXPECT_EQ(drone.counts().imu_dropped, 2U);
  const std::vector<ImuSample> samples = drone.take_imu();
  ASSERT_EQ(samples.size(), 3U);
  EXPECT_EQ(samples.front().stamp_ns, 3000);
  EXPECT_EQ(samples.back().stamp_ns, 5000);
}

TEST(OnboardLink, OneWrongStampOfASensorCostsThatSampleAlone) {
  constexpr TimeNs kFarAhead_ns = 1'000'000'000'000'000'000;
  OnboardLink drone(onboard_config(), "world", "imu");
  SensorPlayer player(onboard_config());
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  play_imu(player, {1000, 2000, 3000, kFarAhead_ns});
  for (const TimeNs stamp_ns : {TimeNs{1000}, TimeNs{2000}, TimeNs{3000}, kFarAhead_ns})
    player.play(image(stamp_ns));
  ASSERT_TRUE(eventually([&] { return drone.counts().imu_samples == 4; }));
  EXPECT_FALSE(drone.wait_for_imu(3000, milliseconds(1)));
  play_imu(player, {4000});
  EXPECT_TRUE(drone.wait_for_imu(3000, kPatience));
  EXPECT_EQ(drone.take_imu().size(), 4U);
  player.play(image(4000));
  for (const TimeNs stamp_ns : {1000, 2000, 3000, 4000})
    EXPECT_EQ(drone.next_image(kPatience)->stamp_ns, stamp_ns);
  EXPECT_EQ(drone.counts().imu_stamps.wrong, 1U);
  EXPECT_EQ(drone.counts().image_stamps.wrong, 1U);
}

TEST(OnboardLink, WhatIsMalformedIsCountedWithTopicAndReason) {
  OnboardLink drone(onboard_config(), "world", "imu");
  OnboardParticipant other({onboard_config().domain, true});
  OnboardWriter camera = other.write(image_topic("camera/image_raw"), Keep::kAll);
  ASSERT_TRUE(eventually([&] { return camera.readers() > 0; }));
  camera.send({0, 1, 0, 0, 5, 5, 5, 5});
  ASSERT_TRUE(eventually([&] { return drone.counts().refused == 1; }));
  EXPECT_EQ(drone.counts().last_refusal, "camera/image_raw: sample ends too early");
  EXPECT_EQ(drone.counts().images, 0U);
}

ParticipantOwner foreign_participant() {
  const LinkConfig config = team_config("driver");
  return ParticipantOwner(dds::DomainParticipantFactory::get_instance()->create_participant(
      static_cast<dds::DomainId_t>(config.domain),
      participant_qos(config, std::make_shared<Wire>())));
}

// Of which no other writer's samples may be mixed with its own.
void offer_exclusively(const OnboardTopic& topic, dds::DomainParticipant& driver) {
  dds::DataWriterQos qos;
  qos.ownership().kind = dds::EXCLUSIVE_OWNERSHIP_QOS;
  dds::TypeSupport(new ByteType(topic.type, topic.max_bytes)).register_type(&driver);
  driver.create_publisher(dds::PUBLISHER_QOS_DEFAULT)
      ->create_datawriter(
          driver.create_topic("rt/" + topic.topic, topic.type, dds::TOPIC_QOS_DEFAULT), qos);
}

TEST(OnboardLink, ADriverThatIsNotHeardIsToldWithThePolicyThatDiffers) {
  const OnboardLink drone(onboard_config(), "world", "imu");
  const ParticipantOwner driver = foreign_participant();
  ASSERT_NE(driver, nullptr);
  offer_exclusively(image_topic("camera/image_raw"), *driver);
  ASSERT_TRUE(eventually([&] { return drone.counts().refused == 1; }));
  EXPECT_EQ(drone.counts().last_refusal,
            "camera/image_raw: its driver's QoS differs in ownership from what is asked for");
}

// To the two ports of the first of such participants in the domain.
void send_to_first(const Bytes& packet) {
  const DatagramSocket outsider("127.0.0.1", 1 << 16);
  constexpr int kFirstPorts = 32;  // onboard_participant.cpp
  const int discovery_port = 7410 + 250 * onboard_config().domain + 2 * kFirstPorts;
  for (const int port : {discovery_port, discovery_port + 1})
    ASSERT_TRUE(
        outsider.send(packet.data(), packet.size(), "127.0.0.1", static_cast<std::uint16_t>(port)));
}

// Debian's Fast DDS would end the process: a submessage of statistics that is not the last one.
TEST(OnboardLink, OutlivesAPacketThatFastDdsDoesNot) {
  OnboardLink drone(onboard_config(), "world", "imu");
  Bytes packet = {'R', 'T', 'P', 'S', 2, 3, 1, 0x0f};
  packet.resize(20);
  const Bytes statistics = {0x80, 1, 4, 0, 0, 0, 0, 0}, time = {0x09, 1, 0, 0};
  packet.insert(packet.end(), statistics.begin(), statistics.end());
  packet.insert(packet.end(), time.begin(), time.end());
  send_to_first(packet);
  EXPECT_TRUE(eventually([&] { return drone.counts().malformed_packets == 2; }));
  SensorPlayer player(onboard_config());
  ASSERT_TRUE(eventually([&] { return player.is_heard(); }));
  play_imu(player, {3000, 4000, 5000});
  EXPECT_TRUE(drone.wait_for_imu(4999, kPatience));
}

TEST(OnboardLink, TellsRos2AndPx4WhereItIs) {
  OnboardParticipant other({onboard_config().domain, true});
  std::mutex mutex;
  std::condition_variable told;
  Bytes nav, px4;
  const auto keep_in = [&](Bytes& here) {
    return [&](const Bytes& bytes) {
      const std::lock_guard lock(mutex);
      here = bytes;
      told.notify_all();
    };
  };
  const auto is_heard = [](const std::string& policy) { ADD_FAILURE() << policy; };
  other.read(nav_odometry_topic("odometry"), false, keep_in(nav), is_heard);
  other.read(px4_odometry_topic("fmu/in/vehicle_visual_odometry"), false, keep_in(px4), is_heard);
  OnboardConfig config = onboard_config();
  config.imu_mount_rpy = {0, 0, 0.5};
  OnboardLink drone(config, "uav0/world", "uav0/imu");
  BodyMotion motion;
  motion.odometry = samples::odometry();
  // Best effort: who has just been found may miss the first.
  EXPECT_TRUE(eventually([&] {
    drone.publish(motion);
    std::unique_lock lock(mutex);
    return told.wait_for(lock, milliseconds(20), [&] { return !nav.empty() && !px4.empty(); });
  }));
  EXPECT_EQ(nav, encode_nav_odometry(motion, "uav0/world", "uav0/imu"));
  const Eigen::Quaterniond turned(Eigen::AngleAxisd(0.5, Eigen::Vector3d::UnitZ()));
  EXPECT_EQ(px4, encode_px4_odometry(motion, turned));
}

TEST(OnboardLink, TopicsThatCannotBeAreNamed) {
  const auto link = [](const std::string& imu_topic) {
    OnboardConfig config = onboard_config();
    config.imu_topic = imu_topic;
    return [config] { OnboardLink(config, "world", "imu"); };
  };
  EXPECT_THAT(link("camera/image_raw"),
              ThrowsMessage<std::runtime_error>(HasSubstr("rt/camera/image_raw")));
  EXPECT_THAT(link(""), ThrowsMessage<std::runtime_error>(
                            HasSubstr("topic of sensor_msgs::msg::dds_::Imu_ has no name")));
}

}  // namespace
}  // namespace covey
