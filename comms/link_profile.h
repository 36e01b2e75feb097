// SPDX-License-Identifier: Apache-2.0
//
// How a link behaves on its radio: every value behind the QoS that qos.cpp builds, as plain data.
// The defaults are those of the profile `lossy_wifi`; link_profiles.json holds all profiles, with
// the reason of each value.
#pragma once

#include <cstdint>

namespace covey {

enum class Reliability : std::uint8_t { kBestEffort, kReliable };
enum class History : std::uint8_t { kLast, kAll };

// Both ends of one topic. 0 ms: without such a limit. `reliability` of `request` is what this drone
// asks of others: its own questions are repaired for whoever asks for it.
struct TopicProfile {
  Reliability reliability = Reliability::kReliable;
  History history =
      History::kLast;             // kAll: until acknowledged by all, a full one blocks the sender
  int depth = 1;                  // samples kept per sender
  bool late_joiners = false;      // get what is kept
  int lifespan_ms = 0;            // what is older is neither repaired nor delivered
  int deadline_ms = 0;            // a sample at least so often is promised to the reader
  int liveliness_ms = 0;          // without a sign of life a sender counts as gone
  int max_blocking_ms = 100;      // of a sender whose history is full
  int heartbeat_ms = 60;          // between two offers to repair
  bool piggyback = false;         // an offer along with every datagram as well
  int heartbeat_response_ms = 5;  // from an offer to what the reader misses
  int nack_response_ms = 5;       // from there to the repair
  int flow_bytes = 0;             // at most in flow_period_ms, the rest later; 0: at once
  int flow_period_ms = 100;
};

struct TransportProfile {
  int datagram_bytes = 1472;           // UDP payload at most; larger samples are sent in fragments
  int socket_buffer_kib = 256;         // each way
  int full_message_buffer_kib = 4096;  // instead, where whole filters are exchanged
};

enum class DiscoveryMode : std::uint8_t { kUnicast, kMulticast, kServer };

struct DiscoveryProfile {
  DiscoveryMode mode = DiscoveryMode::kUnicast;
  int lease_ms = 9000;          // a drone that is silent for so long is forgotten
  int announcement_ms = 3000;   // between two, while anybody of the team is missing
  int sign_of_life_ms = 1400;   // of a drone that has nothing else to say
  int first_announcements = 5;  // at the start, in quick succession
  int first_announcement_ms = 100;
  int repeat_ms = 150;     // from describing the own topics to newcomers until again; 0: never
  int ports_per_host = 1;  // where drones of one host are looked for
  int farewell_ms = 0;     // wait at the end until all has been acknowledged
};

// Token buckets. 0 bytes/s: no limit.
struct LoadProfile {
  int drone_bytes_per_s = 250'000;  // of this drone, on the wire: discovery and repair included
  int drone_burst_bytes = 64'000;
  int link_bytes_per_s = 125'000;  // of samples to one peer
  int link_burst_bytes = 32'000;
  int patience_ms = 200;  // what has not found room by then is dropped
};

struct SecurityProfile {
  bool required = false;  // without keys there is no link
};

struct LinkProfile {
  TransportProfile transport;
  DiscoveryProfile discovery;
  LoadProfile load;
  SecurityProfile security;
  TopicProfile request, message, full_message, status, odometry;

  LinkProfile();  // lossy_wifi
};

// Throws std::runtime_error that names the value, what is wrong with it and what to do.
void check(const LinkProfile& profile);

}  // namespace covey
