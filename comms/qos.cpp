// SPDX-License-Identifier: Apache-2.0
#include "comms/qos.h"

#include <fastdds/rtps/attributes/ServerAttributes.h>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <chrono>
#include <random>
#include <string>

#include "comms/key_folder.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::ResourceLimitedContainerConfig;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::Locator_t;
using std::chrono::milliseconds;

constexpr std::size_t kToolEndpoints = 8;  // per participant, on top of what a drone needs

Duration_t or_forever(int time_ms) {
  return time_ms > 0 ? duration(milliseconds(time_ms)) : eprosima::fastrtps::c_TimeInfinite;
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

// 127.0.0.1 knows no multicast.
DiscoveryMode discovery_mode(const LinkConfig& config) {
  const DiscoveryMode chosen = config.profile.discovery.mode;
  const bool impossible = config.loopback_only && chosen == DiscoveryMode::kMulticast;
  return impossible ? DiscoveryMode::kUnicast : chosen;
}

// Port 0: all ports at which a participant of that host may be.
void look_on(const std::vector<std::string>& hosts, dds::WireProtocolConfigQos& wire) {
  for (const std::string& host : hosts) wire.builtin.initialPeersList.push_back(locator(host, 0));
}

std::vector<std::string> addresses_to_sit_on(const LinkConfig& config) {
  const std::vector<std::string> named = own_interfaces(config);
  return named.empty() ? std::vector<std::string>{"0.0.0.0"} : named;
}

// A super client is told of all topics, not only of those that it already has: from their topics
// it learns the other drones' names.
void ask_server(const std::string& address_and_port, dds::WireProtocolConfigQos& wire) {
  const auto colon = address_and_port.find(':');
  eprosima::fastdds::rtps::RemoteServerAttributes server;
  server.ReadguidPrefix(eprosima::fastdds::rtps::DEFAULT_ROS2_SERVER_GUIDPREFIX);
  server.metatrafficUnicastLocatorList.push_back(
      locator(address_and_port.substr(0, colon),
              static_cast<std::uint32_t>(std::stoul(address_and_port.substr(colon + 1)))));
  auto& discovery = wire.builtin.discovery_config;
  discovery.discoveryProtocol = eprosima::fastrtps::rtps::DiscoveryProtocol::SUPER_CLIENT;
  discovery.m_DiscoveryServers.push_back(server);
}

void set_discovery(const LinkConfig& config, dds::WireProtocolConfigQos& wire) {
  const DiscoveryProfile& profile = config.profile.discovery;
  auto& discovery = wire.builtin.discovery_config;
  discovery.leaseDuration = duration(milliseconds(profile.lease_ms));
  discovery.leaseDuration_announcementperiod = duration(milliseconds(profile.announcement_ms));
  discovery.initial_announcements.count = static_cast<std::uint32_t>(profile.first_announcements);
  discovery.initial_announcements.period = duration(milliseconds(profile.first_announcement_ms));
  switch (discovery_mode(config)) {
    case DiscoveryMode::kUnicast:
      look_on(config.loopback_only ? own_interfaces(config) : config.initial_peers, wire);
      return sit_on_ports_from(0, addresses_to_sit_on(config), config.domain, wire);
    case DiscoveryMode::kServer:
      ask_server(config.discovery_server, wire);
      return sit_on_ports_from(0, addresses_to_sit_on(config), config.domain, wire);
    case DiscoveryMode::kMulticast:
      return;  // which Fast DDS sets up by itself
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

// Participants of one host sit on ports one after the other; so many of them are tried.
int ports_looked_at(const LinkConfig& config) {
  if (!config.loopback_only) return config.profile.discovery.ports_per_host;
  return config.team_size > 0 ? config.team_size : config.max_agents;
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

// What is protected, and how, says the signed governance (access_rules.h).
void set_security(const LinkConfig& config, dds::PropertyPolicyQos& qos) {
  if (config.security.empty()) return;
  const std::string identity = "dds.sec.auth.builtin.PKI-DH.";
  const std::string access = "dds.sec.access.builtin.Access-Permissions.";
  const std::pair<std::string, const char*> files[] = {
      {identity + "identity_ca", kIdentityAuthorityFile},
      {identity + "identity_certificate", kCertificateFile},
      {identity + "identity_crl", kRevokedFile},
      {identity + "private_key", kPrivateKeyFile},
      {access + "permissions_ca", kPermissionsAuthorityFile},
      {access + "governance", kGovernanceFile},
      {access + "permissions", kPermissionsFile}};
  auto& properties = qos.properties();
  properties.emplace_back("dds.sec.auth.plugin", "builtin.PKI-DH");
  properties.emplace_back("dds.sec.access.plugin", "builtin.Access-Permissions");
  properties.emplace_back("dds.sec.crypto.plugin", "builtin.AES-GCM-GMAC");
  for (const auto& [property, file] : files)
    properties.emplace_back(property, "file://" + (key_folder(config) / file).string());
}

const TopicProfile& topic_profile(Kind kind, const LinkProfile& profile) {
  switch (kind) {
    case Kind::kRequest:
      return profile.request;
    case Kind::kMessage:
      return profile.message;
    case Kind::kFullMessage:
      return profile.full_message;
    case Kind::kStatus:
      return profile.status;
    case Kind::kOdometry:
      break;
  }
  return profile.odometry;
}

struct Room {
  int senders = 1;  // who share one history
  int instances = 1;
};

// What writer and reader have in common.
template <typename Qos>
void set_topic(const TopicProfile& topic, const Room& room, Qos& qos) {
  const bool all = topic.history == History::kAll;
  qos.reliability().kind = topic.reliability == Reliability::kReliable
                               ? dds::RELIABLE_RELIABILITY_QOS
                               : dds::BEST_EFFORT_RELIABILITY_QOS;
  qos.reliability().max_blocking_time = duration(milliseconds(topic.max_blocking_ms));
  qos.durability().kind =
      topic.late_joiners ? dds::TRANSIENT_LOCAL_DURABILITY_QOS : dds::VOLATILE_DURABILITY_QOS;
  qos.history().kind = all ? dds::KEEP_ALL_HISTORY_QOS : dds::KEEP_LAST_HISTORY_QOS;
  qos.history().depth = all ? topic.depth : topic.depth * room.senders;
  auto& limits = qos.resource_limits();
  limits.max_instances = room.instances;
  limits.max_samples_per_instance = qos.history().depth;
  limits.max_samples = limits.max_samples_per_instance * limits.max_instances;
  limits.allocated_samples = 1;
  qos.deadline().period = or_forever(topic.deadline_ms);
  qos.data_sharing().off();
}

// The bytes of a flow are spread over its periods by a thread of DDS.
void set_publishing(const TopicProfile& topic, dds::DataWriterQos& qos) {
  const bool flow = topic.flow_bytes > 0;
  qos.publish_mode().kind = flow ? dds::ASYNCHRONOUS_PUBLISH_MODE : dds::SYNCHRONOUS_PUBLISH_MODE;
  if (!flow) return;
  qos.throughput_controller().bytesPerPeriod = static_cast<std::uint32_t>(topic.flow_bytes);
  qos.throughput_controller().periodMillisecs = static_cast<std::uint32_t>(topic.flow_period_ms);
}

}  // namespace

Duration_t duration(milliseconds time) {
  return {static_cast<std::int32_t>(time.count() / 1000),
          static_cast<std::uint32_t>(time.count() % 1000 * 1000000)};
}

void sit_on_ports_from(int participant, const std::vector<std::string>& addresses, int domain,
                       dds::WireProtocolConfigQos& wire) {
  for (const std::string& address : addresses) {
    const std::uint32_t port = wire.port.getUnicastPort(static_cast<std::uint32_t>(domain),
                                                        static_cast<std::uint32_t>(participant));
    wire.builtin.metatrafficUnicastLocatorList.push_back(locator(address, port));
    wire.default_unicast_locator_list.push_back(locator(address, port + 1));
  }
}

bool is_heard_at(std::uint32_t port, const LinkConfig& config) {
  if (discovery_mode(config) == DiscoveryMode::kMulticast) return true;
  const dds::WireProtocolConfigQos wire;
  const std::uint32_t end = wire.port.getUnicastPort(static_cast<std::uint32_t>(config.domain),
                                                     wire.builtin.mutation_tries);
  return port != 0 && port < end;
}

bool is_looked_at(std::uint32_t port, const LinkConfig& config) {
  if (discovery_mode(config) != DiscoveryMode::kUnicast) return true;
  const auto last = static_cast<std::uint32_t>(ports_looked_at(config) - 1);
  const dds::WireProtocolConfigQos wire;
  return port <= wire.port.getUnicastPort(static_cast<std::uint32_t>(config.domain), last);
}

std::shared_ptr<UDPv4TransportDescriptor> udp_transport(const LinkConfig& config) {
  const TransportProfile& profile = config.profile.transport;
  auto out = std::make_shared<UDPv4TransportDescriptor>();
  out->interfaceWhiteList = own_interfaces(config);
  out->maxMessageSize = static_cast<std::uint32_t>(profile.datagram_bytes);
  out->sendBufferSize =
      1024 * static_cast<std::uint32_t>(config.full_messages ? profile.full_message_buffer_kib
                                                             : profile.socket_buffer_kib);
  out->receiveBufferSize = out->sendBufferSize;
  out->maxInitialPeersRange = static_cast<std::uint32_t>(ports_looked_at(config));
  return out;
}

dds::DomainParticipantQos participant_qos(const LinkConfig& config,
                                          const std::shared_ptr<Wire>& wire) {
  dds::DomainParticipantQos qos;
  qos.name(("covey/" + config.team + "/" + config.agent).c_str());
  // By default Fast DDS tells everybody the names of host and user.
  qos.properties().properties().clear();
  set_security(config, qos.properties());
  qos.transport().use_builtin_transports = false;
  qos.transport().user_transports.push_back(
      std::make_shared<CountingTransportDescriptor>(udp_transport(config), wire));
  qos.wire_protocol().prefix = fresh_prefix();
  set_discovery(config, qos.wire_protocol());
  set_limits(config, qos.allocation());
  return qos;
}

dds::DataWriterQos writer_qos(Kind kind, const LinkConfig& config) {
  const TopicProfile& topic = topic_profile(kind, config.profile);
  dds::DataWriterQos qos;
  set_topic(topic, Room(), qos);
  // Each reader of questions says whether it wants them repaired: profiles may be mixed.
  if (kind == Kind::kRequest) qos.reliability().kind = dds::RELIABLE_RELIABILITY_QOS;
  set_publishing(topic, qos);
  // Own samples are of known size: no more is taken than each needs.
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::DYNAMIC_REUSABLE_MEMORY_MODE;
  qos.reliable_writer_qos().times.heartbeatPeriod = duration(milliseconds(topic.heartbeat_ms));
  qos.reliable_writer_qos().times.nackResponseDelay =
      duration(milliseconds(topic.nack_response_ms));
  qos.reliable_writer_qos().disable_heartbeat_piggyback = !topic.piggyback;
  qos.lifespan().duration = or_forever(topic.lifespan_ms);
  // What is written, or said with a heartbeat, is the sign of life itself: nothing is sent besides.
  // No reader of ours asks for it: whatever a drone says tells them that it is there.
  if (topic.liveliness_ms > 0) {
    qos.liveliness().kind = dds::MANUAL_BY_TOPIC_LIVELINESS_QOS;
    qos.liveliness().lease_duration = duration(milliseconds(topic.liveliness_ms));
  }
  return qos;
}

dds::DataReaderQos reader_qos(Kind kind, const LinkConfig& config) {
  const TopicProfile& topic = topic_profile(kind, config.profile);
  // A status is keyed by its drone: strangers get as much room as the drones of the team.
  const Room room =
      kind == Kind::kStatus ? Room{1, 2 * config.max_agents} : Room{config.max_agents, 1};
  dds::DataReaderQos qos;
  set_topic(topic, room, qos);
  // Blocks of the largest allowed size: a packet that claims a larger sample is refused.
  qos.endpoint().history_memory_policy = eprosima::fastrtps::rtps::PREALLOCATED_MEMORY_MODE;
  qos.reliable_reader_qos().times.heartbeatResponseDelay =
      duration(milliseconds(topic.heartbeat_response_ms));
  return qos;
}

}  // namespace covey
