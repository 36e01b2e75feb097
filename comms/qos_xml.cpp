// SPDX-License-Identifier: Apache-2.0
#include "comms/qos_xml.h"

#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>
#include <fastrtps/utils/IPLocator.h>

#include <memory>
#include <sstream>

#include "comms/config_check.h"
#include "comms/qos.h"
#include "comms/xml_tag.h"

namespace covey {
namespace {

namespace dds = eprosima::fastdds::dds;
using eprosima::fastdds::rtps::UDPv4TransportDescriptor;
using eprosima::fastrtps::Duration_t;
using eprosima::fastrtps::ResourceLimitedContainerConfig;
using eprosima::fastrtps::rtps::DiscoveryProtocol;
using eprosima::fastrtps::rtps::IPLocator;
using eprosima::fastrtps::rtps::LocatorList_t;

template <typename Number>
std::string number(const std::string& name, Number value) {
  return tag(name, std::to_string(value));
}

std::string flag(const std::string& name, bool value) {
  return tag(name, value ? "true" : "false");
}

std::string time(const std::string& name, const Duration_t& duration) {
  if (duration == eprosima::fastrtps::c_TimeInfinite)
    return tag(name, tag("sec", "DURATION_INFINITY"));
  return tag(name, number("sec", duration.seconds) + number("nanosec", duration.nanosec));
}

// --------------------------------------------------------------------------------- participant

std::string locators(const std::string& name, const LocatorList_t& list) {
  std::string out;
  for (const auto& locator : list)
    out += tag("locator", tag("udpv4", number("port", locator.port) +
                                           tag("address", IPLocator::toIPv4string(locator))));
  return out.empty() ? "" : tag(name, "\n" + out);
}

std::string servers(const dds::WireProtocolConfigQos& wire) {
  std::string out;
  for (const auto& server : wire.builtin.discovery_config.m_DiscoveryServers) {
    std::ostringstream prefix;
    prefix << server.guidPrefix;
    out += tag("RemoteServer prefix=\"" + prefix.str() + "\"",
               locators("metatrafficUnicastLocatorList", server.metatrafficUnicastLocatorList));
  }
  return out.empty() ? "" : tag("discoveryServersList", "\n" + out);
}

std::string discovery(const dds::WireProtocolConfigQos& wire) {
  const auto& config = wire.builtin.discovery_config;
  const bool simple = config.discoveryProtocol == DiscoveryProtocol::SIMPLE;
  return tag(
      "discovery_config",
      "\n" + tag("discoveryProtocol", simple ? "SIMPLE" : "SUPER_CLIENT") +
          time("leaseDuration", config.leaseDuration) +
          time("leaseAnnouncement", config.leaseDuration_announcementperiod) +
          tag("initialAnnouncements", number("count", config.initial_announcements.count) +
                                          time("period", config.initial_announcements.period)) +
          servers(wire));
}

std::string at_most(const std::string& name, const ResourceLimitedContainerConfig& limit) {
  return tag(name, number("initial", limit.initial) + number("maximum", limit.maximum) +
                       number("increment", limit.increment));
}

std::string allocation(const dds::ParticipantResourceLimitsQos& limits) {
  return tag("allocation", "\n" + at_most("total_participants", limits.participants) +
                               at_most("total_readers", limits.readers) +
                               at_most("total_writers", limits.writers) +
                               number("max_properties", limits.data_limits.max_properties) +
                               number("max_user_data", limits.data_limits.max_user_data) +
                               number("max_partitions", limits.data_limits.max_partitions));
}

std::string transport(const UDPv4TransportDescriptor& udp) {
  std::string interfaces;
  for (const std::string& address : udp.interfaceWhiteList)
    interfaces += tag("address", escaped(address));
  if (!interfaces.empty()) interfaces = tag("interfaceWhiteList", interfaces);
  return tag("transport_descriptor",
             "\n" + tag("transport_id", "covey_udp") + tag("type", "UDPv4") +
                 number("sendBufferSize", udp.sendBufferSize) +
                 number("receiveBufferSize", udp.receiveBufferSize) +
                 number("maxMessageSize", udp.maxMessageSize) +
                 number("maxInitialPeersRange", udp.maxInitialPeersRange) + interfaces);
}

std::string properties(const dds::PropertyPolicyQos& qos) {
  std::string out;
  for (const auto& property : qos.properties())
    out += tag("property",
               tag("name", escaped(property.name())) + tag("value", escaped(property.value())));
  return out.empty() ? "" : tag("propertiesPolicy", tag("properties", "\n" + out));
}

std::string participant(const LinkConfig& config, const dds::DomainParticipantQos& qos) {
  const dds::WireProtocolConfigQos& wire = qos.wire_protocol();
  const std::string builtin =
      discovery(wire) + locators("initialPeersList", wire.builtin.initialPeersList) +
      locators("metatrafficUnicastLocatorList", wire.builtin.metatrafficUnicastLocatorList);
  return tag(
      "participant profile_name=\"covey\"",
      "\n" + number("domainId", config.domain) +
          tag("rtps", "\n" + tag("name", escaped(qos.name().to_string())) +
                          tag("userTransports", tag("transport_id", "covey_udp")) +
                          flag("useBuiltinTransports", false) +
                          locators("defaultUnicastLocatorList", wire.default_unicast_locator_list) +
                          tag("builtin", "\n" + builtin) + allocation(qos.allocation()) +
                          properties(qos.properties())));
}

// -------------------------------------------------------------------------------------- topics

template <typename Qos>
std::string history(const Qos& qos) {
  const auto& limits = qos.resource_limits();
  const bool all = qos.history().kind == dds::KEEP_ALL_HISTORY_QOS;
  return tag("topic",
             "\n" +
                 tag("historyQos", tag("kind", all ? "KEEP_ALL" : "KEEP_LAST") +
                                       number("depth", qos.history().depth)) +
                 tag("resourceLimitsQos",
                     number("max_samples", limits.max_samples) +
                         number("max_instances", limits.max_instances) +
                         number("max_samples_per_instance", limits.max_samples_per_instance) +
                         number("allocated_samples", limits.allocated_samples)));
}

template <typename Qos>
std::string policies(const Qos& qos) {
  const bool reliable = qos.reliability().kind == dds::RELIABLE_RELIABILITY_QOS;
  const bool manual = qos.liveliness().kind == dds::MANUAL_BY_TOPIC_LIVELINESS_QOS;
  const bool late_joiners = qos.durability().kind == dds::TRANSIENT_LOCAL_DURABILITY_QOS;
  return tag("reliability", tag("kind", reliable ? "RELIABLE" : "BEST_EFFORT") +
                                time("max_blocking_time", qos.reliability().max_blocking_time)) +
         tag("durability", tag("kind", late_joiners ? "TRANSIENT_LOCAL" : "VOLATILE")) +
         tag("deadline", time("period", qos.deadline().period)) +
         tag("liveliness", tag("kind", manual ? "MANUAL_BY_TOPIC" : "AUTOMATIC") +
                               time("lease_duration", qos.liveliness().lease_duration) +
                               time("announcement_period", qos.liveliness().announcement_period)) +
         tag("data_sharing", tag("kind", "OFF"));
}

std::string writer(const std::string& topic, const dds::DataWriterQos& qos) {
  const auto& reliable = qos.reliable_writer_qos();
  const auto& flow = qos.throughput_controller();
  const bool spread = qos.publish_mode().kind == dds::ASYNCHRONOUS_PUBLISH_MODE;
  std::string out = "\n" + history(qos);
  out +=
      tag("qos", "\n" + policies(qos) + tag("lifespan", time("duration", qos.lifespan().duration)) +
                     tag("publishMode", tag("kind", spread ? "ASYNCHRONOUS" : "SYNCHRONOUS")) +
                     flag("disable_heartbeat_piggyback", reliable.disable_heartbeat_piggyback));
  out += tag("times", "\n" + time("heartbeatPeriod", reliable.times.heartbeatPeriod) +
                          time("nackResponseDelay", reliable.times.nackResponseDelay));
  if (spread)
    out += tag("throughputController", number("bytesPerPeriod", flow.bytesPerPeriod) +
                                           number("periodMillisecs", flow.periodMillisecs));
  out += tag("historyMemoryPolicy", "DYNAMIC_REUSABLE");
  return tag("data_writer profile_name=\"" + topic + "_writer\"", out);
}

std::string reader(const std::string& topic, const dds::DataReaderQos& qos) {
  const auto& times = qos.reliable_reader_qos().times;
  return tag("data_reader profile_name=\"" + topic + "_reader\"",
             "\n" + history(qos) + tag("qos", "\n" + policies(qos)) +
                 tag("times", time("heartbeatResponseDelay", times.heartbeatResponseDelay)) +
                 tag("historyMemoryPolicy", "PREALLOCATED"));
}

}  // namespace

std::string qos_xml(const LinkConfig& config) {
  check(config);
  const auto participant_qos = covey::participant_qos(config, std::make_shared<Wire>());
  std::string profiles = tag("transport_descriptors", "\n" + transport(*udp_transport(config))) +
                         participant(config, participant_qos);
  const std::pair<const char*, Kind> topics[] = {{"request", Kind::kRequest},
                                                 {"message", Kind::kMessage},
                                                 {"full_message", Kind::kFullMessage},
                                                 {"status", Kind::kStatus},
                                                 {"odometry", Kind::kOdometry}};
  for (const auto& [name, kind] : topics)
    profiles += writer(name, writer_qos(kind, config)) + reader(name, reader_qos(kind, config));
  return "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n" +
         tag("dds xmlns=\"http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles\"",
             "\n" + tag("profiles", "\n" + profiles));
}

}  // namespace covey
