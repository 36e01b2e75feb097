// SPDX-License-Identifier: Apache-2.0
#include "comms/qos.h"

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <chrono>
#include <random>
#include <string>

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::ResourceLimitedContainerConfig;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using std::chrono::milliseconds;

constexpr std::uint32_t kMaxDatagramBytes = 1400;  // of UDP payload: one Ethernet or Wi-Fi frame
constexpr std::uint32_t kSocketBufferBytes = 256 * 1024;  // a burst of the largest messages
constexpr std::uint32_t kFullSocketBufferBytes = 4 * 1024 * 1024;  // a burst of whole filters
constexpr std::uint32_t kParticipantsPerRemoteHost = 4;            // a drone and a few tools
constexpr int kLockstepHistory = 256;                              // samples not yet acknowledged
constexpr std::size_t kToolEndpoints = 8;  // per participant, on top of what a drone needs

constexpr milliseconds kHeartbeat{40};
constexpr milliseconds kResponseDelay{5};
constexpr milliseconds kRequestLifespan{200};

// Signs of life. In lockstep a drone may get no processor for seconds and be well.
struct Leases {
  milliseconds participant;
  milliseconds announcement;
  milliseconds liveliness;
  milliseconds blocking;  // longest wait of a sender whose history is full
};

Leases leases_of(LinkProfile profile) {
  if (profile == LinkProfile::kLockstep)
    return {milliseconds(20000), milliseconds(2000), milliseconds(20000), milliseconds(30000)};
  return {milliseconds(4000), milliseconds(1000), milliseconds(1500), milliseconds(100)};
}

Locator_t locator(const std::string& address, std::uint32_t port) {
  Locator_t out;
  IPLocator::setIPv4(out, address);
  out.port = port;
  return out;
}

std::vector<std::string> own_interfaces(const LinkConfig& config) {
  return config.loopback_only ? std::vector<std::string>{"127.0.0.1"} : config.interfaces;
}

std::vector<std::string> hosts_to_look_on(const LinkConfig& config) {
  return config.loopback_only ? std::vector<std::string>{"127.0.0.1"} : config.initial_peers;
}

std::shared_ptr<UDPv4TransportDescriptor> udp(const LinkConfig& config) {
  auto out = std::make_shared<UDPv4TransportDescriptor>();
  out->interfaceWhiteList = own_interfaces(config);
  out->maxMessageSize = kMaxDatagramBytes;
  out->sendBufferSize = config.full_messages ? kFullSocketBufferBytes : kSocketBufferBytes;
  out->receiveBufferSize = out->sendBufferSize;
  // Participants of one host sit on ports one after the other; so many of them are tried.
  out->maxInitialPeersRange = config.loopback_only ? static_cast<std::uint32_t>(config.max_agents)
                                                   : kParticipantsPerRemoteHost;
  return out;
}

void set_addresses(const LinkConfig& config, dds::WireProtocolConfigQos& wire) {
  const std::vector<std::string> hosts = hosts_to_look_on(config);
  if (hosts.empty()) return;  // multicast, which Fast DDS sets up by itself
  // Port 0: all ports at which a participant of that host may be.
  for (const std::string& host : hosts) wire.builtin.initialPeersList.push_back(locator(host, 0));
  std::vector<std::string> addresses = own_interfaces(config);
  if (addresses.empty()) addresses = {"0.0.0.0"};
  // The first participant's ports, or the next free ones: Fast DDS tries them in turn. Left to
  // itself, it would count participants per process, and a link that was renewed often enough would
  // sit on a port where nobody looks.
  const auto domain = static_cast<std::uint32_t>(config.domain);
  for (const std::string& address : addresses) {
    wire.builtin.metatrafficUnicastLocatorList.push_back(
        locator(address, wire.port.getUnicastPort(domain, 0)));
    wire.default_unicast_locator_list.push_back(
        locator(address, wire.port.getUnicastPort(domain, 0) + 1));
  }
}

// Fast DDS makes the same prefix again for the next participant of a process; those who have not
// noticed the end of the old one would then take the new one's samples for repetitions.
eprosima::fastrtps::rtps::GuidPrefix_t fresh_prefix() {
  eprosima::fastrtps::rtps::GuidPrefix_t out;
  std::random_device random;
  for (auto& byte : out.value) byte = static_cast<std::uint8_t>(random());
  out.value[0] = 0x01;  // eProsima's vendor id
  out.value[1] = 0x0f;
  return out;
}

ResourceLimitedContainerConfig at_most(std::size_t maximum) { return {1, maximum, 1}; }

void set_limits(const LinkConfig& config, dds::ParticipantResourceLimitsQos& limits) {
  const auto agents = static_cast<std::size_t>(config.max_agents);
  limits.participants = at_most(agents + kToolEndpoints);
  limits.readers = at_most(3 + kToolEndpoints);
  limits.writers = at_most(3 + agents + kToolEndpoints);  // one answer topic per peer
  limits.data_limits.max_properties = 512;
  limits.data_limits.max_user_data = 256;
  limits.data_limits.max_partitions = 256;
}

bool is_message(Kind kind) { return kind == Kind::kMessage || kind == Kind::kFullMessage; }

bool keeps_all(Kind kind, const LinkConfig& config) {
  return config.profile == LinkProfile::kLockstep && (kind == Kind::kRequest || is_message(kind));
}

int history_depth(Kind kind) {
  switch (kind) {
    case Kind::kRequest:
      return 8;
    case Kind::kMessage:
    case Kind::kFullMessage:
      return 4;
    case Kind::kStatus:
    case Kind::kOdometry:
      break;
  }
  return 1;
}

// What writer and reader have in common; `senders` is how many share one reader's history.
template <typename Qos>
void set_topic(Kind kind, const LinkConfig& config, int senders, Qos& qos) {
  const bool all = keeps_all(kind, config);
  const bool state = kind == Kind::kStatus;
  const int depth = history_depth(kind) * senders;
  qos.reliability().kind =
      kind == Kind::kOdometry ? dds::BEST_EFFORT_RELIABILITY_QOS : dds::RELIABLE_RELIABILITY_QOS;
  qos.reliability().max_blocking_time = duration(leases_of(config.profile).blocking);
  qos.durability().kind =
      state ? dds::TRANSIENT_LOCAL_DURABILITY_QOS : dds::VOLATILE_DURABILITY_QOS;
  qos.history().kind = all ? dds::KEEP_ALL_HISTORY_QOS : dds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = depth;
  auto& limits = qos.resource_limits();
  limits.max_instances = 1;  // no keys
  limits.max_samples_per_instance = all ? kLockstepHistory : depth;
  limits.max_samples = limits.max_samples_per_instance;
  limits.allocated_samples = 1;
  if (state) {
    const milliseconds lease = leases_of(config.profile).liveliness;
    qos.liveliness().kind = dds::AUTOMATIC_LIVELINESS_QOS;
    qos.liveliness().lease_duration = duration(lease);
    qos.liveliness().announcement_period = duration(lease / 3);
  }
  qos.data_sharing().off();
}

}  // namespace

Duration_t duration(milliseconds time) {
  return {static_cast<std::int32_t>(time.count() / 1000),
          static_cast<std::uint32_t>(time.count() % 1000 * 1000000)};
}

dds::DomainParticipantQos participant_qos(const LinkConfig& config,
                                          const std::shared_ptr<WireCounters>& counters) {
  const Leases leases = leases_of(config.profile);
  dds::DomainParticipantQos qos;
  qos.name(("covey/" + config.team + "/" + config.agent).c_str());
  // By default Fast DDS tells everybody the names of host and user.
  qos.properties().properties().clear();
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(
      std::make_shared<CountingTransportDescriptor>(udp(config), counters));
  qos.wire_protocol().prefix = fresh_prefix();
  auto& discovery = qos.wire_protocol().builtin.discovery_config;
  discovery.leaseDuration = duration(leases.participant);
  discovery.leaseDuration_announcementperiod = duration(leases.announcement);
  set_addresses(config, qos.wire_protocol());
  set_limits(config, qos.allocation());
  return qos;
}

dds::DataWriterQos writer_qos(Kind kind, const LinkConfig& config) {
  dds::DataWriterQos qos;
  set_topic(kind, config, 1, qos);
  // Own samples are of known size: no more is taken than each needs.
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::DYNAMIC_REUSABLE_MEMORY_MODE;
  qos.publish_mode().kind = dds::SYNCHRONOUS_PUBLISH_MODE;
  qos.reliable_writer_qos().times.heartbeatPeriod = duration(kHeartbeat);
  qos.reliable_writer_qos().times.nackResponseDelay = duration(kResponseDelay);
  qos.reliable_writer_qos().disable_heartbeat_piggyback = is_message(kind);
  if (kind == Kind::kRequest && config.profile == LinkProfile::kRadio)
    qos.lifespan().duration = duration(kRequestLifespan);
  return qos;
}

dds::DataReaderQos reader_qos(Kind kind, const LinkConfig& config) {
  dds::DataReaderQos qos;
  set_topic(kind, config, config.max_agents, qos);
  // Blocks of the largest allowed size: a packet that claims a larger sample is refused.
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_MEMORY_MODE;
  qos.reliable_reader_qos().times.heartbeatResponseDelay = duration(kResponseDelay);
  return qos;
}

}  // namespace covey
