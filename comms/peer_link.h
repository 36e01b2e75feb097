// SPDX-License-Identifier: Apache-2.0
//
// The radio of one drone: plain structs out, plain structs in. Fast DDS, IDL types and every QoS
// choice (qos.h says which and why) stay behind this header.
//
//   topic                            who writes     who reads
//   covey/<team>/request             every drone    every drone
//   covey/<team>/message/<receiver>  who answers    <receiver> only
//     or full_message/<receiver>     the same, where whole filters are exchanged
//   covey/<team>/status              every drone    every drone
//   covey/<team>/odometry            every drone    whoever listens (ground station)
//
// What comes in was checked (convert.h) and waits in a bounded inbox that drops its oldest. The DDS
// threads decode, push and return: nothing of the caller runs there. All members may be called from
// any thread.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "comms/link_profile.h"
#include "estimator/filter_snapshot.h"
#include "estimator/measurements.h"

namespace covey {

struct LinkConfig {
  std::string agent;           // 1..32 characters of [A-Za-z0-9_-], unique in its team
  std::string team = "covey";  // same characters; teams do not hear each other
  int domain = 0;              // DDS domain, 0..200
  LinkProfile profile;
  int max_agents = 16;  // per team, this one included; also how many per host are looked for
  // The messages of this team carry whole filters, FullPeerKeyframe instead of PeerKeyframe. Drones
  // of the other sort are not heard.
  bool full_messages = false;

  bool loopback_only = true;            // nothing leaves 127.0.0.1; the next two are then ignored
  std::vector<std::string> interfaces;  // own IPv4 addresses, usually one; empty: all
  std::vector<std::string> initial_peers;  // IPv4 hosts to look for drones on, unless by multicast
  std::string discovery_server;            // IPv4:PORT, for DiscoveryMode::kServer

  // Folder that holds this drone's keys in <security>/<agent>/ (key_folder.h): its team is
  // encrypted and nobody else can take part. Empty: an open link.
  std::string security;

  std::size_t inbox_limit = 256;  // messages not yet taken, all kinds together
};

using Inbound = std::variant<PlaceAdvert, PeerKeyframe, FullPeerKeyframe, AgentStatus>;

// Samples of one kind. Payload bytes are the serialised sample, without RTPS and UDP headers. What
// is sent to all drones counts once.
struct KindStatistics {
  std::uint64_t sent = 0;
  std::uint64_t received = 0;  // accepted by the checks
  std::uint64_t refused =
      0;  // not sent: receiver unknown, would not pass the receiver's checks, history full
  std::uint64_t payload_bytes_sent = 0;
  std::uint64_t payload_bytes_received = 0;
};

struct LinkStatistics {
  KindStatistics request;                                 // PlaceAdvert
  KindStatistics message;                                 // PeerKeyframe or FullPeerKeyframe
  KindStatistics status;                                  // AgentStatus
  KindStatistics odometry;                                // never received here
  std::map<std::string, std::uint64_t> messages_sent_to;  // by receiver
  // By peer, then by reason. A sender that cannot be told is "unknown".
  std::map<std::string, std::map<std::string, std::uint64_t>> rejected;
  std::map<std::string, std::uint64_t> refused;  // by reason
  // By kind and reason: dropped on purpose, because the radio's budget had no room (outbox.h).
  std::map<std::string, std::uint64_t> dropped;
  std::uint64_t inbox_dropped = 0;
  // Errors that Fast DDS reports: malformed packets, exhausted limits. Of the whole process.
  std::uint64_t dds_errors = 0;
  std::string last_dds_error;
  // All packets of this link, discovery and repair included: UDP payloads, and 28 bytes of IPv4 and
  // UDP header for each.
  std::uint64_t wire_bytes_sent = 0;
  std::uint64_t wire_bytes_received = 0;
};

// How many samples of a kind have arrived since the start, accepted or rejected.
struct ArrivalCounts {
  std::uint64_t requests = 0;
  std::uint64_t messages = 0;
};

class PeerLink {
 public:
  // Throws std::runtime_error that names the setting or the DDS entity and what to do.
  explicit PeerLink(const LinkConfig& config);
  // First waits up to discovery.farewell_ms for flush(): else what was said last may be lost.
  ~PeerLink();
  PeerLink(PeerLink&&) noexcept;
  PeerLink& operator=(PeerLink&&) noexcept;

  // False: not sent, counted in `refused` with a reason. `sender` must be this agent. Where the
  // profile limits the load, what finds no room may wait for up to its patience, and be dropped.
  bool send(const PlaceAdvert& advert);
  bool send(const PeerKeyframe& keyframe);  // reaches only keyframe.receiver
  // Only with LinkConfig::full_messages. Without a receiver it goes to every drone that is there.
  bool send(const FullPeerKeyframe& message);
  bool publish(const Odometry& odometry);
  bool publish(const AgentStatus& status);  // late joiners get the last one

  // Everything that arrived since the last call, in order of arrival.
  [[nodiscard]] std::vector<Inbound> take();

  // Drones whose topics are matched both ways: they hear this one and this one hears them.
  [[nodiscard]] std::set<std::string> peers() const;

  // True once all of these, or at least that many drones, are matched both ways.
  [[nodiscard]] bool wait_for_peers(const std::set<std::string>& names,
                                    std::chrono::milliseconds timeout);
  [[nodiscard]] bool wait_for_peers(std::size_t count, std::chrono::milliseconds timeout);

  // True once at least that many have arrived since the start: with the senders' counts, a lockstep
  // run knows that nothing is under way any more.
  [[nodiscard]] bool wait_for_inbox(const ArrivalCounts& at_least,
                                    std::chrono::milliseconds timeout);
  [[nodiscard]] ArrivalCounts arrived() const;

  // True once every peer that is there has acknowledged all requests and messages.
  bool flush(std::chrono::milliseconds timeout);

  [[nodiscard]] LinkStatistics statistics() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace covey
