// SPDX-License-Identifier: Apache-2.0
//
// A participant that is not ours: it says what no link of ours would say, and listens to what links
// only say.
#include <fastdds/rtps/attributes/ServerAttributes.h>
#include <fastrtps/utils/IPLocator.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <condition_variable>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/domain/DomainParticipantListener.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/DataWriterListener.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <map>
#include <mutex>
#include <sstream>
#include <string>

#include "comms/byte_type.h"
#include "comms/dds_owners.h"
#include "comms/qos.h"
#include "tests/comms/samples.h"
#include "tests/comms/team_config.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastrtps::types::ReturnCode_t;

// A value that one thread sets and another waits for.
template <typename T>
class Awaited {
 public:
  void set(T value) {
    const std::lock_guard lock(mutex_);
    value_ = std::move(value);
    changed_.notify_all();
  }
  template <typename Test>
  T wait_until(Test test, std::chrono::milliseconds patience = kPatience) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, patience, [&] { return test(value_); });
    return value_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  T value_{};
};

class Stranger : public dds::DataWriterListener, public dds::DataReaderListener {
 public:
  Stranger() : config_(team_config("stranger")) {
    participant_.reset(dds::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<dds::DomainId_t>(config_.domain),
        participant_qos(config_, std::make_shared<Wire>())));
    if (participant_ == nullptr) throw std::runtime_error("no participant");
    publisher_ = create_publisher(*participant_);
    if (publisher_ == nullptr) throw std::runtime_error("no publisher");
  }

  // Returns a writer that has found its reader.
  dds::DataWriter* writer(Kind kind, const std::string& topic, const std::string& type,
                          std::size_t max_bytes) {
    dds::DataWriter* out = publisher_->create_datawriter(create_topic(topic, type, max_bytes),
                                                         writer_qos(kind, config_), this);
    if (matched_.wait_until([](int count) { return count > 0; }) == 0)
      throw std::runtime_error("no match for " + topic);
    return out;
  }
  void listen(Kind kind, const std::string& topic, const std::string& type) {
    dds::Subscriber* subscriber = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
    subscriber->create_datareader(create_topic(topic, type, 1024), reader_qos(kind, config_), this);
    if (matched_.wait_until([](int count) { return count > 0; }) == 0)
      throw std::runtime_error("no match for " + topic);
  }
  Bytes heard_within(std::chrono::milliseconds time) {
    return heard_.wait_until([](const Bytes& bytes) { return !bytes.empty(); }, time);
  }
  [[nodiscard]] std::string topic(const std::string& name) const {
    return "covey/" + config_.team + "/" + name;
  }

  void on_publication_matched(dds::DataWriter* /*writer*/,
                              const dds::PublicationMatchedStatus& status) override {
    matched_.set(status.current_count);
  }
  void on_subscription_matched(dds::DataReader* /*reader*/,
                               const dds::SubscriptionMatchedStatus& status) override {
    matched_.set(status.current_count);
  }
  void on_data_available(dds::DataReader* reader) override {
    ByteSample sample;
    dds::SampleInfo info;
    while (reader->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK)
      if (info.valid_data) heard_.set(sample.bytes);
  }

 private:
  dds::Topic* create_topic(const std::string& topic, const std::string& type,
                           std::size_t max_bytes) {
    const KeyOf key_of = type == "covey::wire::AgentStatus" ? key_of_status : nullptr;
    dds::TypeSupport(new ByteType(type, max_bytes, key_of)).register_type(participant_.get());
    return participant_->create_topic(topic, type, dds::TOPIC_QOS_DEFAULT);
  }

  const LinkConfig config_;
  Awaited<int> matched_;
  Awaited<Bytes> heard_;
  // End first: until then they call back.
  ParticipantOwner participant_;
  PublisherOwner publisher_;
};

bool say(dds::DataWriter* writer, Bytes bytes) {
  ByteSample sample{std::move(bytes)};
  return writer->write(&sample);
}

TEST(ForeignDds, BrokenSamplesAreCountedAndTheLinkGoesOn) {
  // A sample may come before the link knows its writer: then it is repaired.
  LinkConfig config = team_config("uav0");
  config.profile = lossless_profile();
  PeerLink link(config);
  Stranger stranger;
  dds::DataWriter* writer = stranger.writer(Kind::kMessage, stranger.topic("request"),
                                            "covey::wire::RequestUAV", kMaxRequestBytes);
  Bytes bad_header = encode(samples::advert("uav1"));
  bad_header[0] = 0xff;
  Bytes truncated = encode(samples::advert("uav1"));
  truncated.resize(500);
  std::uint64_t sent = 0;
  for (const Bytes& bytes :
       {bad_header, truncated, Bytes{0, 1, 0, 0}, Bytes{0, 1, 0, 0, kWireVersion}}) {
    ASSERT_TRUE(say(writer, bytes));
    ASSERT_TRUE(link.wait_for_inbox({++sent, 0}, kPatience));
  }
  ASSERT_TRUE(say(writer, encode(samples::advert("uav1", 77))));
  ASSERT_TRUE(link.wait_for_inbox({++sent, 0}, kPatience));

  auto rejected = link.statistics().rejected["unknown"];
  EXPECT_EQ(rejected["unknown encapsulation"], 1u);
  EXPECT_EQ(rejected["sample ends too early"], 2u);
  EXPECT_EQ(rejected["sample too short"], 1u);
  const std::vector<Inbound> inbox = link.take();
  ASSERT_EQ(inbox.size(), 1u);
  EXPECT_EQ(std::get<PlaceAdvert>(inbox[0]).keyframe_id, 77u);
}

// Its fragments alone would take a megabyte of every reader.
TEST(ForeignDds, AnOversizedSampleIsNotAssembled) {
  PeerLink link(team_config("uav0"));
  Stranger stranger;
  constexpr std::size_t kHuge = 1 << 20;
  dds::DataWriter* writer = stranger.writer(Kind::kMessage, stranger.topic("message/uav0"),
                                            "covey::wire::MessageUAV", kHuge);
  Bytes huge = encode(samples::keyframe("uav1", "uav0"));
  huge.resize(kHuge);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(say(writer, huge));
  ASSERT_TRUE(say(writer, encode(samples::keyframe("uav1", "uav0"))));
  ASSERT_TRUE(link.wait_for_inbox({0, 1}, kPatience));
  EXPECT_EQ(link.arrived().messages, 1u);
  EXPECT_TRUE(link.statistics().rejected.empty());
  EXPECT_GE(link.statistics().dds_errors, 3u);
  EXPECT_THAT(link.statistics().last_dds_error, testing::HasSubstr("1048576"));
}

TEST(ForeignDds, ABrokenStatusDoesNotKeepDronesApart) {
  PeerLink link(team_config("uav0")), peer(team_config("uav1"));
  Stranger stranger;
  dds::DataWriter* writer = stranger.writer(Kind::kStatus, stranger.topic("status"),
                                            "covey::wire::AgentStatus", kMaxStatusBytes);
  for (const Bytes& bytes : {Bytes{0xff, 0xff, 0, 0}, Bytes{0, 1, 0, 0, 1, 0, 0, 0, 255, 255, 255}})
    ASSERT_TRUE(say(writer, bytes));
  EXPECT_TRUE(link.wait_for_peers({"uav1"}, kPatience));
  EXPECT_TRUE(peer.wait_for_peers({"uav0"}, kPatience));
}

// As `fast-discovery-server -i 0` runs it.
class DiscoveryServer {
 public:
  explicit DiscoveryServer(std::uint32_t port) {
    dds::DomainParticipantQos qos;
    qos.transport().use_builtin_transports = false;
    qos.transport().user_transports.push_back(udp_transport(team_config("server")));
    auto& wire = qos.wire_protocol();
    std::istringstream(eprosima::fastdds::rtps::DEFAULT_ROS2_SERVER_GUIDPREFIX) >> wire.prefix;
    eprosima::fastrtps::rtps::Locator_t locator;
    eprosima::fastrtps::rtps::IPLocator::setIPv4(locator, "127.0.0.1");
    locator.port = port;
    wire.builtin.metatrafficUnicastLocatorList.push_back(locator);
    wire.builtin.discovery_config.discoveryProtocol =
        eprosima::fastrtps::rtps::DiscoveryProtocol::SERVER;
    participant_.reset(dds::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<dds::DomainId_t>(team_config("server").domain), qos));
    if (participant_ == nullptr) throw std::runtime_error("no discovery server");
  }

 private:
  ParticipantOwner participant_;
};

TEST(ForeignDds, ADiscoveryServerBringsDronesTogether) {
  const std::uint32_t port = 11'000 + static_cast<std::uint32_t>(getpid()) % 6'000;
  const DiscoveryServer server(port);
  const auto config = [&](const std::string& agent) {
    LinkConfig out = team_config(agent);
    out.profile.discovery.mode = DiscoveryMode::kServer;
    out.discovery_server = "127.0.0.1:" + std::to_string(port);
    return out;
  };
  PeerLink a(config("uav0")), b(config("uav1"));
  ASSERT_TRUE(a.wait_for_peers({"uav1"}, kPatience));
  ASSERT_TRUE(b.wait_for_peers({"uav0"}, kPatience));
  ASSERT_TRUE(a.send(samples::keyframe("uav0", "uav1")));
  EXPECT_TRUE(b.wait_for_inbox({0, 1}, kPatience));
}

TEST(ForeignDds, AStatusIsKeyedByItsDrone) {
  ByteType type("covey::wire::AgentStatus", kMaxStatusBytes, key_of_status);
  const auto key = [&](const Bytes& bytes) {
    ByteSample sample{bytes};
    eprosima::fastrtps::rtps::InstanceHandle_t handle;
    EXPECT_TRUE(type.getKey(&sample, &handle, false));
    return handle;
  };
  const auto uav0 = key(encode(StatusSample{samples::status("uav0", 1), {}}));
  EXPECT_EQ(uav0, key(encode(StatusSample{samples::status("uav0", 2), {{7}}})));
  EXPECT_FALSE(uav0 == key(encode(StatusSample{samples::status("uav1", 1), {}})));
  EXPECT_EQ(key(Bytes{0xff, 0xff, 0, 0}), key({}));  // unreadable: the empty key, no exception
}

TEST(ForeignDds, AGroundStationReadsOdometry) {
  PeerLink link(team_config("uav0"));
  Stranger ground;
  ground.listen(Kind::kOdometry, ground.topic("odometry"), "covey::wire::Odometry");
  // Best effort, and the drone may not know its listener yet: it says it until it is heard.
  Bytes bytes;
  const auto start = std::chrono::steady_clock::now();
  while (bytes.empty() && std::chrono::steady_clock::now() - start < kPatience) {
    ASSERT_TRUE(link.publish(samples::odometry()));
    bytes = ground.heard_within(std::chrono::milliseconds(20));
  }
  const auto decoded = decode_odometry(bytes);
  ASSERT_TRUE(std::holds_alternative<OdometrySample>(decoded));
  EXPECT_EQ(std::get<OdometrySample>(decoded).agent, "uav0");
}

// Hears what the drones of a team say of their topics, and is never linked with them.
class Onlooker : public dds::DomainParticipantListener {
 public:
  explicit Onlooker(std::string team) : team_(std::move(team)) {
    const LinkConfig config = team_config("onlooker");
    participant_.reset(dds::DomainParticipantFactory::get_instance()->create_participant(
        static_cast<dds::DomainId_t>(config.domain),
        participant_qos(config, std::make_shared<Wire>()), this, dds::StatusMask::none()));
    if (participant_ == nullptr) throw std::runtime_error("no participant");
  }

  void on_publisher_discovery(dds::DomainParticipant* /*participant*/,
                              eprosima::fastrtps::rtps::WriterDiscoveryInfo&& info) override {
    count(info.info.topicName().to_string());
  }
  void on_subscriber_discovery(dds::DomainParticipant* /*participant*/,
                               eprosima::fastrtps::rtps::ReaderDiscoveryInfo&& info) override {
    count(info.info.topicName().to_string());
  }
  // Waits until each of so many topics has been described so often.
  std::map<std::string, int> described(std::size_t topics, int times) {
    return described_.wait_until([&](const std::map<std::string, int>& counts) {
      return counts.size() >= topics &&
             std::all_of(counts.begin(), counts.end(),
                         [&](const auto& topic) { return topic.second >= times; });
    });
  }

 private:
  // Other teams may be in the same domain.
  void count(const std::string& topic) {
    if (topic.rfind(team_, 0) != 0) return;
    const std::lock_guard lock(mutex_);
    ++descriptions_[topic];
    described_.set(descriptions_);
  }

  const std::string team_;  // as topics begin
  std::mutex mutex_;
  std::map<std::string, int> descriptions_;
  Awaited<std::map<std::string, int>> described_;
  ParticipantOwner participant_;  // ends first: until then it calls back
};

TEST(ForeignDds, WhoDoesNotGetLinkedIsToldOfTheTopicsAgain) {
  LinkConfig config = team_config("uav0");
  config.profile.discovery.repeat_ms = 5;
  const std::string team = "covey/" + config.team;
  Onlooker onlooker(team + "/");
  const PeerLink link(config);
  const std::map<std::string, int> described = onlooker.described(4, 3);
  // Request and status have a writer and a reader each: twice without any repetition.
  for (const char* topic : {"/request", "/status", "/odometry", "/message/uav0"}) {
    ASSERT_TRUE(described.count(team + topic)) << topic;
    EXPECT_GE(described.at(team + topic), 3) << topic;
  }
}

}  // namespace
}  // namespace covey
