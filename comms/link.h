// SPDX-License-Identifier: Apache-2.0
//
// What a drone asks of its radio, and what it is told: plain structs. The radio is in this process
// (peer_link.h) or in one of its own, which may crash or hang without any harm to the drone
// (apps/link_process.h).
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <variant>
#include <vector>

#include "comms/clock_offset.h"
#include "estimator/filter_snapshot.h"
#include "estimator/measurements.h"

namespace covey {

using Inbound = std::variant<PlaceAdvert, PeerKeyframe, FullPeerKeyframe, AgentStatus>;

// Why samples are rejected that claim to come from this drone itself.
inline constexpr char kNamesake[] = "another drone bears this drone's name";
// Why a drone that is there gets no answers: counted once for each.
inline constexpr char kCrowd[] = "more drones are there than link.max_agents";

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
  // UDP port at which no other drone looks for this one, because other programs have those before
  // it; 0: all look where it is. Of now, not summed.
  std::uint64_t unseen_port = 0;
  // Of the network that the settings want, what is not usable now, and why: the link goes on
  // without it, or waits for it. Empty: nothing. Of now, not summed.
  std::string missing_network;
  // By peer, from its statuses; also of those that have left.
  std::map<std::string, ClockOffset> clocks;
  // Of a link in a process of its own: how often it was started anew, by reason, and its cost.
  std::map<std::string, std::uint64_t> restarts;
  std::uint64_t process_cpu_ms = 0;
  std::uint64_t process_peak_kib = 0;  // resident memory
  std::uint64_t process_own_kib = 0;   // its own (anonymous) memory, now; not summed, not told
};

// Names come from the network: those beyond a few hundred count together, as "others".
void count_one(const std::string& name, std::map<std::string, std::uint64_t>* counts);

// Of a link that was started anew: what the lives before and the present one add up to, names as
// above. Peaks are the higher one, the last error and each clock are the later ones.
[[nodiscard]] LinkStatistics sum(LinkStatistics before, const LinkStatistics& now);

// How many samples of a kind have arrived since the start, accepted or rejected.
struct ArrivalCounts {
  std::uint64_t requests = 0;
  std::uint64_t messages = 0;
};

class Link {
 public:
  Link() = default;
  Link(const Link&) = delete;
  Link& operator=(const Link&) = delete;
  virtual ~Link() = default;

  // False: not sent, counted in `refused` with a reason. `sender` must be this agent. Where the
  // profile limits the load, what finds no room may wait for up to its patience, and be dropped.
  virtual bool send(const PlaceAdvert& advert) = 0;
  virtual bool send(const PeerKeyframe& keyframe) = 0;  // reaches only keyframe.receiver
  // Only with LinkConfig::full_messages. Without a receiver it goes to every drone that is there.
  virtual bool send(const FullPeerKeyframe& message) = 0;
  virtual bool publish(const Odometry& odometry) = 0;
  virtual bool publish(const AgentStatus& status) = 0;

  // Everything that arrived since the last call, in order of arrival.
  [[nodiscard]] virtual std::vector<Inbound> take() = 0;

  // Drones whose topics are matched both ways: they hear this one and this one hears them.
  [[nodiscard]] virtual std::set<std::string> peers() const = 0;

  // True once all of these, or at least that many drones, are matched both ways.
  [[nodiscard]] virtual bool wait_for_peers(const std::set<std::string>& names,
                                            std::chrono::milliseconds timeout) = 0;
  [[nodiscard]] virtual bool wait_for_peers(std::size_t count,
                                            std::chrono::milliseconds timeout) = 0;

  // True once at least that many have arrived since the start: with the senders' counts, a lockstep
  // run knows that nothing is under way any more.
  [[nodiscard]] virtual bool wait_for_inbox(const ArrivalCounts& at_least,
                                            std::chrono::milliseconds timeout) = 0;
  [[nodiscard]] virtual ArrivalCounts arrived() const = 0;

  // The last word: waits a little for it to arrive. From then on statistics() is final.
  virtual void close() = 0;

  [[nodiscard]] virtual LinkStatistics statistics() const = 0;
};

}  // namespace covey
