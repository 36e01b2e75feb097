// SPDX-License-Identifier: Apache-2.0
//
// What is exported is what is flown: Fast DDS reads the XML back into the QoS that a link uses.
#include "comms/qos_xml.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <filesystem>
#include <memory>

#include "comms/qos.h"
#include "tests/apps/temporary_folder.h"
#include "tests/comms/secure_team.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::PropertyPolicyHelper;
using eprosima::fastrtps::types::ReturnCode_t;

// Every value is another one than Fast DDS's own, so that one that is lost shows.
LinkConfig unusual_config(LinkConfig config) {
  config.interfaces = {"127.0.0.1"};
  config.initial_peers = {"127.0.0.1"};
  config.loopback_only = false;
  TransportProfile& transport = config.profile.transport;
  transport.datagram_bytes = 7654;
  transport.socket_buffer_kib = 99;
  DiscoveryProfile& discovery = config.profile.discovery;
  discovery.lease_ms = 7001;
  discovery.announcement_ms = 1503;
  discovery.first_announcements = 9;
  discovery.first_announcement_ms = 77;
  discovery.ports_per_host = 3;
  TopicProfile& message = config.profile.message;
  message.history = History::kAll;
  message.depth = 17;
  message.lifespan_ms = 2345;
  message.deadline_ms = 3456;
  message.max_blocking_ms = 45;
  message.heartbeat_ms = 56;
  message.piggyback = true;
  message.heartbeat_response_ms = 6;
  message.nack_response_ms = 7;
  message.flow_bytes = 5678;
  message.flow_period_ms = 89;
  return config;
}

class LoadedXml {
 public:
  explicit LoadedXml(const LinkConfig& config) {
    const std::string xml = qos_xml(config);
    loaded_ =
        factory_->load_XML_profiles_string(xml.data(), xml.size()) == ReturnCode_t::RETCODE_OK;
    dds::DomainParticipantQos qos = participant();
    participant_ = factory_->create_participant(static_cast<dds::DomainId_t>(config.domain), qos);
    if (participant_ == nullptr) throw std::runtime_error("no participant from this XML");
    publisher_ = participant_->create_publisher(dds::PUBLISHER_QOS_DEFAULT);
    subscriber_ = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  }
  ~LoadedXml() {
    participant_->delete_contained_entities();
    factory_->delete_participant(participant_);
  }
  LoadedXml(const LoadedXml&) = delete;
  LoadedXml& operator=(const LoadedXml&) = delete;

  [[nodiscard]] bool loaded() const { return loaded_; }
  [[nodiscard]] dds::DomainParticipantQos participant() const {
    dds::DomainParticipantQos qos;
    factory_->get_participant_qos_from_profile("covey", qos);
    return qos;
  }
  [[nodiscard]] dds::DataWriterQos writer(const std::string& topic) const {
    dds::DataWriterQos qos;
    EXPECT_EQ(publisher_->get_datawriter_qos_from_profile(topic + "_writer", qos),
              ReturnCode_t::RETCODE_OK);
    return qos;
  }
  [[nodiscard]] dds::DataReaderQos reader(const std::string& topic) const {
    dds::DataReaderQos qos;
    EXPECT_EQ(subscriber_->get_datareader_qos_from_profile(topic + "_reader", qos),
              ReturnCode_t::RETCODE_OK);
    return qos;
  }

 private:
  dds::DomainParticipantFactory* factory_ = dds::DomainParticipantFactory::get_instance();
  bool loaded_ = false;
  dds::DomainParticipant* participant_ = nullptr;
  dds::Publisher* publisher_ = nullptr;
  dds::Subscriber* subscriber_ = nullptr;
};

// Profiles of one process are known by name for good: one test for all.
TEST(QosXml, FastDdsReadsBackWhatALinkUses) {
  const SecureTeam team({"uav0"});
  LinkConfig config = unusual_config(team.config("uav0"));
  const TemporaryFolder folder;
  const auto keys = folder.path() / "R&D's <keys> \"1\"";  // marks of XML: paths may hold them
  std::filesystem::copy(config.security, keys, std::filesystem::copy_options::recursive);
  config.security = keys;
  const LoadedXml xml(config);
  ASSERT_TRUE(xml.loaded());
  const std::pair<const char*, Kind> topics[] = {{"request", Kind::kRequest},
                                                 {"message", Kind::kMessage},
                                                 {"full_message", Kind::kFullMessage},
                                                 {"status", Kind::kStatus},
                                                 {"odometry", Kind::kOdometry}};
  for (const auto& [topic, kind] : topics) {
    EXPECT_TRUE(xml.writer(topic) == writer_qos(kind, config)) << topic;
    EXPECT_TRUE(xml.reader(topic) == reader_qos(kind, config)) << topic;
  }

  const auto read = xml.participant();
  const auto used = participant_qos(config, std::make_shared<Wire>());
  EXPECT_EQ(read.name(), used.name());
  EXPECT_TRUE(read.allocation() == used.allocation());
  ASSERT_EQ(used.properties().properties().size(), 10u);  // three plugins, seven files
  for (const auto& property : used.properties().properties()) {
    const std::string* value =
        PropertyPolicyHelper::find_property(read.properties(), property.name());
    ASSERT_NE(value, nullptr) << property.name();
    EXPECT_EQ(*value, property.value());
  }
  EXPECT_FALSE(read.transport().use_builtin_transports);
  const auto& read_wire = read.wire_protocol();
  const auto& used_wire = used.wire_protocol();
  EXPECT_TRUE(read_wire.default_unicast_locator_list == used_wire.default_unicast_locator_list);
  EXPECT_TRUE(read_wire.builtin.initialPeersList == used_wire.builtin.initialPeersList);
  EXPECT_TRUE(read_wire.builtin.metatrafficUnicastLocatorList ==
              used_wire.builtin.metatrafficUnicastLocatorList);
  EXPECT_TRUE(read_wire.builtin.discovery_config == used_wire.builtin.discovery_config);
  using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
  ASSERT_EQ(read.transport().user_transports.size(), 1u);
  const auto udp =
      std::dynamic_pointer_cast<UDPv4TransportDescriptor>(read.transport().user_transports[0]);
  ASSERT_NE(udp, nullptr);
  EXPECT_TRUE(*udp == *udp_transport(config));
}

TEST(QosXml, AConfigurationThatCannotWorkIsRefused) {
  LinkConfig config = unusual_config(team_config("uav0"));
  config.profile.message.flow_bytes = 100;
  EXPECT_THROW((void)qos_xml(config), std::runtime_error);
}

}  // namespace
}  // namespace covey
