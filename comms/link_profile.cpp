// SPDX-License-Identifier: Apache-2.0
#include "comms/link_profile.h"

#include <stdexcept>
#include <string>

namespace covey {
namespace {

constexpr int kMinFlowBytes = 512;

void require(bool good, const std::string& complaint) {
  if (!good) throw std::runtime_error("link profile: " + complaint);
}

bool is_reliable(const TopicProfile& topic) { return topic.reliability == Reliability::kReliable; }

void check_repair(const std::string& name, const TopicProfile& topic) {
  require(topic.lifespan_ms == 0 || topic.lifespan_ms > topic.heartbeat_ms,
          name + ".lifespan_ms is not above heartbeat_ms: it would expire before any repair");
}

void check_topic(const std::string& name, const TopicProfile& topic) {
  require(topic.depth > 0, name + ".depth is 0: nothing could be sent");
  require(topic.history == History::kLast || is_reliable(topic),
          name + ".history all needs reliability: nobody would ever acknowledge");
  if (is_reliable(topic)) check_repair(name, topic);
  require(topic.liveliness_ms == 0 || topic.liveliness_ms >= 100,
          name + ".liveliness_ms is below 100: a busy processor would look like death");
  require(topic.flow_bytes == 0 || topic.flow_bytes >= kMinFlowBytes,
          name + ".flow_bytes is below " + std::to_string(kMinFlowBytes) +
              ": hardly more than headers would ever pass");
}

void check_bucket(const std::string& name, int rate, int burst, int datagram_bytes) {
  require(rate == 0 || burst >= datagram_bytes,
          "load." + name + "_burst_bytes is below transport.datagram_bytes: nothing would ever go");
}

}  // namespace

LinkProfile::LinkProfile() {
  request.reliability = Reliability::kBestEffort;
  request.heartbeat_ms = 50;
  message.piggyback = true;
  request.nack_response_ms = message.nack_response_ms = 1;
  request.depth = 8;
  request.lifespan_ms = 200;
  request.heartbeat_response_ms = 2;
  message.depth = full_message.depth = 4;
  status.late_joiners = true;
  status.liveliness_ms = 1900;
  status.piggyback = true;
  odometry.reliability = Reliability::kBestEffort;
  full_message.heartbeat_ms = status.heartbeat_ms = odometry.heartbeat_ms = 40;
}

void check(const LinkProfile& profile) {
  const int datagram_bytes = profile.transport.datagram_bytes;
  check_topic("request", profile.request);
  check_repair("request", profile.request);  // offered, whatever the own reader asks for
  check_topic("message", profile.message);
  check_topic("full_message", profile.full_message);
  check_topic("status", profile.status);
  check_topic("odometry", profile.odometry);
  require(is_reliable(profile.status) && profile.status.late_joiners &&
              profile.status.liveliness_ms > 0,
          "status must be reliable, kept for late_joiners and watched by liveliness_ms: by it "
          "drones know who is there");
  const DiscoveryProfile& discovery = profile.discovery;
  require(discovery.lease_ms >= 2 * discovery.announcement_ms,
          "discovery.lease_ms is below twice announcement_ms: one lost packet would end a drone");
  require(
      discovery.sign_of_life_ms < profile.status.liveliness_ms,
      "discovery.sign_of_life_ms is not below status.liveliness_ms: a quiet drone would count as "
      "lost");
  const LoadProfile& load = profile.load;
  check_bucket("drone", load.drone_bytes_per_s, load.drone_burst_bytes, datagram_bytes);
  check_bucket("link", load.link_bytes_per_s, load.link_burst_bytes, datagram_bytes);
}

}  // namespace covey
