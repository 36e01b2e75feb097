// SPDX-License-Identifier: Apache-2.0
//
// Who is matched with whom. DDS matches each topic by itself, and each side at its own time: a
// writer may know its reader while the reader does not know the writer yet, and what is written in
// between is lost. So every drone tells in its status whom it hears on all topics, and a peer
// counts as linked once both say so. Not thread-safe.
#pragma once

#include <netinet/in.h>

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "comms/convert.h"

namespace covey {

using PeerId = std::array<std::uint8_t, 12>;  // GUID prefix: another one after each restart

// How a peer is named in a status (idl: AgentStatus.hears).
[[nodiscard]] std::uint64_t token(const PeerId& id);

enum class Channel : std::uint8_t {
  kRequestOut,
  kRequestIn,
  kMessageOut,
  kMessageIn,
  kStatusOut,
  kStatusIn,
};
inline constexpr std::size_t kChannels = 6;

// That has come, whatever it says.
struct Packet {
  PeerId sender{};
  in_addr_t from = 0;
  bool announces = false;  // its sender, and says nothing else
};

// Whatever comes from a peer is a sign of life, but for its announcements: who is linked says more,
// and who has lost this drone goes on announcing itself. Who has been silent for `doubt` is to be
// asked; who goes on being silent is gone.
struct SilenceLimits {
  std::chrono::milliseconds doubt{1500}, gone{1900};
};

class PeerTable {
 public:
  using Time = std::chrono::steady_clock::time_point;

  // `limit` peers at most: what comes after is not entered, a flood of strangers costs no memory.
  explicit PeerTable(std::size_t limit) : limit_(limit) {}

  void set_name(const PeerId& id, const std::string& name);
  void change_matches(const PeerId& id, Channel channel, int difference);
  bool hear(const Packet& packet, Time now);  // whether its sender had been gone
  void set_hears(const PeerId& id, std::vector<std::uint64_t> tokens);
  // Of its newest status: its wall clock when it was sent, the own one when it came.
  void set_status_stamps(const PeerId& id, TimeNs sent_ns, TimeNs received_ns);
  void remove(const PeerId& id);

  struct Silence {
    bool doubt = false;  // somebody is to be asked, once until it is heard again
    bool gone = false;   // somebody is no longer there
  };
  [[nodiscard]] Silence check_silence(const SilenceLimits& limits, Time now);
  // Nothing while nobody is there.
  [[nodiscard]] std::optional<Time> next_check(const SilenceLimits& limits, Time now) const;

  [[nodiscard]] std::set<std::string> names() const;
  [[nodiscard]] std::string name_of(const PeerId& id) const;  // "unknown" if not told yet
  [[nodiscard]] bool reaches(const std::string& name) const;  // an answer would have a reader
  // Peers matched on all channels, as seen from here alone: what goes into the own status.
  [[nodiscard]] std::vector<HeardPeer> heard() const;
  // Peers matched on all channels as seen from both sides, and alive.
  [[nodiscard]] std::set<std::string> linked(std::uint64_t own_token) const;
  [[nodiscard]] bool is_linked(const PeerId& id, std::uint64_t own_token) const;
  // Where they were heard from.
  [[nodiscard]] std::set<in_addr_t> linked_addresses(std::uint64_t own_token) const;

 private:
  struct Peer {
    std::string name;
    std::array<int, kChannels> matches{};
    std::vector<std::uint64_t> hears;
    std::optional<Time> heard;  // last; nothing before the first check
    in_addr_t address = 0;      // from where
    bool doubted = false;
    TimeNs status_sent_ns = 0, status_received_ns = 0;
    bool alive = true;
  };
  Peer* find_or_enter(const PeerId& id);
  bool forget_one_unmatched();
  static bool matched_everywhere(const Peer& peer);
  static bool is_linked(const Peer& peer, std::uint64_t own_token);

  std::size_t limit_;
  std::map<PeerId, Peer> peers_;
};

}  // namespace covey
