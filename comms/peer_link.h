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
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "comms/link.h"
#include "comms/link_profile.h"

namespace covey {

// Drones in a team. A status has room for twice as many that are heard (kMaxHears): drones that
// come back are other ones until their ghosts have gone, and strangers may be about.
inline constexpr int kMaxAgents = 32;

struct LinkConfig {
  std::string agent;           // 1..32 characters of [A-Za-z0-9_-], unique in its team
  std::string team = "covey";  // same characters; teams do not hear each other
  int domain = 0;              // DDS domain, 0..200
  LinkProfile profile;
  // At once, this one included. Who has left makes room.
  int max_agents = 16;
  // How many there will be, this one included: on one host they are not looked for on more ports
  // than that, and no longer once all are linked. 0: not known, max_agents at most.
  int team_size = 0;
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
  int max_memory_mib = 128;       // MiB of its own, for a link in a process of its own
};

class PeerLink : public Link {
 public:
  // Throws std::runtime_error that names the setting or the DDS entity and what to do.
  explicit PeerLink(const LinkConfig& config, const WallClock& clock = wall_clock_ns);
  ~PeerLink() override;  // after close()
  PeerLink(const PeerLink&) = delete;
  PeerLink& operator=(const PeerLink&) = delete;

  bool send(const PlaceAdvert& advert) override;
  bool send(const PeerKeyframe& keyframe) override;
  bool send(const FullPeerKeyframe& message) override;
  bool publish(const Odometry& odometry) override;
  bool publish(const AgentStatus& status) override;  // late joiners get the last one

  [[nodiscard]] std::vector<Inbound> take() override;
  [[nodiscard]] std::set<std::string> peers() const override;

  [[nodiscard]] bool wait_for_peers(const std::set<std::string>& names,
                                    std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool wait_for_peers(std::size_t count, std::chrono::milliseconds timeout) override;
  [[nodiscard]] bool wait_for_inbox(const ArrivalCounts& at_least,
                                    std::chrono::milliseconds timeout) override;
  [[nodiscard]] ArrivalCounts arrived() const override;

  // True once every peer that is there has acknowledged all requests and messages.
  bool flush(std::chrono::milliseconds timeout);
  void close() override;  // flush() for up to discovery.farewell_ms

  [[nodiscard]] LinkStatistics statistics() const override;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace covey
