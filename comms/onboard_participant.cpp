// SPDX-License-Identifier: Apache-2.0
#include "comms/onboard_participant.h"

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <exception>
#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/DataReaderListener.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/dds/topic/Topic.hpp>
#include <fastdds/dds/topic/TypeSupport.hpp>
#include <stdexcept>
#include <utility>
#include <vector>

#include "comms/byte_type.h"
#include "comms/checked_transport.h"
#include "comms/dds_log.h"
#include "comms/dds_owners.h"
#include "comms/qos.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using eprosima::fastrtps::types::ReturnCode_t;
using std::chrono::milliseconds;

constexpr milliseconds kMaxBlocking{5000};

void require(bool good, const std::string& complaint) {
  if (good) return;
  const std::string said = dds_errors().last;
  throw std::runtime_error("onboard: " + complaint + (said.empty() ? "" : "; DDS says: " + said));
}

// What ROS 2's middleware makes of the name of a topic.
std::string wire_name(const std::string& topic) {
  const bool has_slash = topic.rfind('/', 0) == 0;
  return has_slash ? "rt" + topic : "rt/" + topic;
}

constexpr int kProgramsOnBoard = 64;  // whose ports are looked at
constexpr int kFirstPorts = 32;       // ours: the first ones are the radio's, in whose domain it is

Locator_t locator(const std::string& address, std::uint32_t port) {
  Locator_t out;
  IPLocator::setIPv4(out, address);
  out.port = port;
  return out;
}

std::shared_ptr<eprosima::fastdds::rtps::UDPv4TransportDescriptor> transport() {
  constexpr std::uint32_t kSocketBuffer = 4 << 20;  // a few images, where the system grants it
  auto out = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  out->sendBufferSize = out->receiveBufferSize = kSocketBuffer;
  out->maxInitialPeersRange = kProgramsOnBoard;
  return out;
}

// Who comes later is called within a second: what it says to all is heard by nobody here.
void look_on_this_computer(int domain, dds::WireProtocolConfigQos& wire) {
  constexpr milliseconds kAnnouncements{1000};
  wire.builtin.discovery_config.leaseDuration_announcementperiod = duration(kAnnouncements);
  const std::uint32_t to_all = wire.port.getMulticastPort(static_cast<std::uint32_t>(domain));
  wire.builtin.initialPeersList.push_back(locator("127.0.0.1", 0));  // all ports of programs
  wire.builtin.initialPeersList.push_back(locator(kDiscoveryGroup, to_all));
  sit_on_ports_from(kFirstPorts, {"0.0.0.0"}, domain, wire);
}

dds::DomainParticipantQos participant_qos(const OnboardNetwork& network,
                                          std::shared_ptr<PacketCount> malformed) {
  dds::DomainParticipantQos qos;
  qos.name("covey/onboard");
  qos.properties().properties().clear();  // names of host and user
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(std::make_shared<CheckedTransportDescriptor>(
      transport(), std::move(malformed),
      network.loopback_only ? Reach::kThisComputer : Reach::kEverybody));
  if (network.loopback_only) look_on_this_computer(network.domain, qos.wire_protocol());
  return qos;
}

// What readers and writers have in common.
template <typename Qos>
void set_topic(Keep keep, Qos& qos) {
  constexpr int kDepth = 256;  // about a second of an IMU
  qos.reliability().kind = dds::RELIABLE_RELIABILITY_QOS;
  qos.history().kind = keep == Keep::kAll ? dds::KEEP_ALL_HISTORY_QOS : dds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = kDepth;
  auto& limits = qos.resource_limits();
  limits.max_samples = limits.max_samples_per_instance = kDepth;
  limits.max_instances = 1;
  limits.allocated_samples = 1;
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::DYNAMIC_REUSABLE_MEMORY_MODE;
  qos.data_sharing().off();
}

// Those that a reader and a writer must agree on (DDS 1.4, 2.2.3).
std::string name_of(dds::QosPolicyId_t policy) {
  switch (policy) {
    case dds::RELIABILITY_QOS_POLICY_ID:
      return kReliability;
    case dds::DURABILITY_QOS_POLICY_ID:
      return "durability";
    case dds::DEADLINE_QOS_POLICY_ID:
      return "deadline";
    case dds::LIVELINESS_QOS_POLICY_ID:
      return "liveliness";
    case dds::OWNERSHIP_QOS_POLICY_ID:
      return "ownership";
    case dds::DESTINATIONORDER_QOS_POLICY_ID:
      return "destination order";
    case dds::PRESENTATION_QOS_POLICY_ID:
      return "presentation";
    case dds::LATENCYBUDGET_QOS_POLICY_ID:
      return "latency budget";
    case dds::DATAREPRESENTATION_QOS_POLICY_ID:
      return "data representation";
    default:
      return "policy " + std::to_string(policy);
  }
}

class Listener : public dds::DataReaderListener {
 public:
  Listener(std::function<void(const Bytes&)> received,
           std::function<void(const std::string& policy)> unheard)
      : received_(std::move(received)), unheard_(std::move(unheard)) {}

  void on_data_available(dds::DataReader* reader) override {
    ByteSample sample;
    dds::SampleInfo info;
    while (reader->take_next_sample(&sample, &info) == ReturnCode_t::RETCODE_OK) {
      if (!info.valid_data) continue;
      try {
        received_(sample.bytes);
      } catch (const std::exception&) {
        continue;  // out of memory: the sample is lost, the drone is not
      }
    }
  }

  void on_requested_incompatible_qos(dds::DataReader* /*reader*/,
                                     const dds::RequestedIncompatibleQosStatus& status) override {
    unheard_(name_of(status.last_policy_id));
  }

 private:
  const std::function<void(const Bytes&)> received_;
  const std::function<void(const std::string& policy)> unheard_;
};

}  // namespace

class OnboardParticipant::Impl {
 public:
  explicit Impl(const OnboardNetwork& network);

  void read(const OnboardTopic& topic, bool reliable, std::unique_ptr<Listener> listener);
  dds::DataWriter* write(const OnboardTopic& topic, Keep keep);
  std::uint64_t malformed_packets() const { return *malformed_; }

 private:
  dds::Topic* create_topic(const OnboardTopic& topic);

  const std::shared_ptr<PacketCount> malformed_ = std::make_shared<PacketCount>(0);
  std::vector<std::unique_ptr<Listener>> listeners_;  // outlive the participant that calls them
  ParticipantOwner participant_;
  PublisherOwner publisher_;
  dds::Subscriber* subscriber_ = nullptr;
};

OnboardParticipant::Impl::Impl(const OnboardNetwork& network)
    : participant_(
          (keep_dds_errors(), dds::DomainParticipantFactory::get_instance()->create_participant(
                                  static_cast<dds::DomainId_t>(network.domain),
                                  participant_qos(network, malformed_)))) {
  require(participant_ != nullptr, "cannot create the DDS participant in domain " +
                                       std::to_string(network.domain) +
                                       ": check that UDP ports are free");
  publisher_ = create_publisher(*participant_);
  subscriber_ = participant_->create_subscriber(dds::SUBSCRIBER_QOS_DEFAULT);
  require(publisher_ != nullptr && subscriber_ != nullptr,
          "cannot create DDS publisher and subscriber: out of memory?");
}

dds::Topic* OnboardParticipant::Impl::create_topic(const OnboardTopic& topic) {
  require(!topic.topic.empty(), "the topic of " + topic.type + " has no name");
  const dds::TypeSupport type(new ByteType(topic.type, topic.max_bytes));
  require(type.register_type(participant_.get()) == ReturnCode_t::RETCODE_OK,
          "cannot register DDS type " + topic.type);
  const std::string name = wire_name(topic.topic);
  dds::Topic* out = participant_->create_topic(name, topic.type, dds::TOPIC_QOS_DEFAULT);
  require(out != nullptr, "cannot create DDS topic " + name + ": is its name used twice?");
  return out;
}

void OnboardParticipant::Impl::read(const OnboardTopic& topic, bool reliable,
                                    std::unique_ptr<Listener> listener) {
  dds::DataReaderQos qos;
  set_topic(Keep::kNewest, qos);
  if (!reliable) qos.reliability().kind = dds::BEST_EFFORT_RELIABILITY_QOS;
  const dds::StatusMask mask = dds::StatusMask::data_available()
                               << dds::StatusMask::requested_incompatible_qos();
  require(subscriber_->create_datareader(create_topic(topic), qos, listener.get(), mask) != nullptr,
          "cannot create DDS reader of " + wire_name(topic.topic));
  listeners_.push_back(std::move(listener));
}

dds::DataWriter* OnboardParticipant::Impl::write(const OnboardTopic& topic, Keep keep) {
  constexpr milliseconds kHeartbeat{20};
  dds::DataWriterQos qos;
  set_topic(keep, qos);
  qos.reliability().max_blocking_time = duration(kMaxBlocking);
  qos.reliable_writer_qos().times.heartbeatPeriod = duration(kHeartbeat);
  qos.publish_mode().kind = dds::ASYNCHRONOUS_PUBLISH_MODE;  // images are cut into datagrams
  dds::DataWriter* writer = publisher_->create_datawriter(create_topic(topic), qos);
  require(writer != nullptr, "cannot create DDS writer of " + wire_name(topic.topic));
  return writer;
}

bool OnboardWriter::send(Bytes bytes) {
  ByteSample sample{std::move(bytes)};
  return writer_->write(&sample);
}

int OnboardWriter::readers() const {
  dds::PublicationMatchedStatus status;
  writer_->get_publication_matched_status(status);
  return status.current_count;
}

bool OnboardWriter::wait_until_received(milliseconds patience) {
  return writer_->wait_for_acknowledgments(duration(patience)) == ReturnCode_t::RETCODE_OK;
}

OnboardParticipant::OnboardParticipant(const OnboardNetwork& network)
    : impl_(std::make_unique<Impl>(network)) {}
OnboardParticipant::~OnboardParticipant() = default;

void OnboardParticipant::read(const OnboardTopic& topic, bool reliable,
                              std::function<void(const Bytes&)> received,
                              std::function<void(const std::string& policy)> unheard) {
  impl_->read(topic, reliable, std::make_unique<Listener>(std::move(received), std::move(unheard)));
}

OnboardWriter OnboardParticipant::write(const OnboardTopic& topic, Keep keep) {
  return OnboardWriter(impl_->write(topic, keep));
}

std::uint64_t OnboardParticipant::malformed_packets() const { return impl_->malformed_packets(); }

}  // namespace covey
