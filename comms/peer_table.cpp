// SPDX-License-Identifier: Apache-2.0
#include "comms/peer_table.h"

#include <algorithm>
#include <utility>

namespace covey {

// FNV-1a, 64 bit.
std::uint64_t token(const PeerId& id) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;
  for (const std::uint8_t byte : id) hash = (hash ^ byte) * 0x100000001b3ULL;
  return hash;
}

PeerTable::Peer* PeerTable::find_or_enter(const PeerId& id) {
  const auto found = peers_.find(id);
  if (found != peers_.end()) return &found->second;
  if (peers_.size() >= limit_ && !forget_one_unmatched()) return nullptr;
  return &peers_[id];
}

// A sample that is handled after its writer has gone leaves an entry without any match.
bool PeerTable::forget_one_unmatched() {
  const auto stale = std::find_if(peers_.begin(), peers_.end(), [](const auto& entry) {
    const auto& matches = entry.second.matches;
    return std::all_of(matches.begin(), matches.end(), [](int count) { return count == 0; });
  });
  if (stale == peers_.end()) return false;
  peers_.erase(stale);
  return true;
}

void PeerTable::set_name(const PeerId& id, const std::string& name) {
  if (Peer* peer = find_or_enter(id)) peer->name = name;
}

void PeerTable::change_matches(const PeerId& id, Channel channel, int difference) {
  // DDS may report a lost match after the loss of its participant: nothing is entered for that.
  if (difference < 0 && peers_.count(id) == 0) return;
  if (Peer* peer = find_or_enter(id)) {
    int& matches = peer->matches[static_cast<std::size_t>(channel)];
    matches = std::max(0, matches + difference);
  }
}

bool PeerTable::hear(const Packet& packet, Time now) {
  const auto found = peers_.find(packet.sender);
  if (found == peers_.end()) return false;
  found->second.heard = now;
  found->second.address = packet.from;
  found->second.doubted = false;
  return !std::exchange(found->second.alive, true);
}

PeerTable::Silence PeerTable::check_silence(const SilenceLimits& limits, Time now) {
  Silence silence;
  for (auto& [id, peer] : peers_) {
    if (!peer.heard) peer.heard = now;
    if (!peer.alive) continue;
    const auto silent = now - *peer.heard;
    if (silent >= limits.gone) {
      peer.alive = false;
      silence.gone = true;
    } else if (silent >= limits.doubt && !peer.doubted && matched_everywhere(peer)) {
      peer.doubted = true;
      silence.doubt = true;
    }
  }
  return silence;
}

std::optional<PeerTable::Time> PeerTable::next_check(const SilenceLimits& limits, Time now) const {
  std::optional<Time> next;
  for (const auto& [id, peer] : peers_) {
    if (!peer.alive) continue;
    const bool asked = peer.doubted || !matched_everywhere(peer);
    const Time due = peer.heard.value_or(now) + (asked ? limits.gone : limits.doubt);
    next = std::min(next.value_or(due), due);
  }
  return next;
}

void PeerTable::set_hears(const PeerId& id, std::vector<std::uint64_t> tokens) {
  if (Peer* peer = find_or_enter(id)) peer->hears = std::move(tokens);
}

void PeerTable::set_status_stamps(const PeerId& id, TimeNs sent_ns, TimeNs received_ns) {
  if (Peer* peer = find_or_enter(id)) {
    peer->status_sent_ns = sent_ns;
    peer->status_received_ns = received_ns;
  }
}

void PeerTable::remove(const PeerId& id) { peers_.erase(id); }

std::set<std::string> PeerTable::names() const {
  std::set<std::string> out;
  for (const auto& [id, peer] : peers_)
    if (!peer.name.empty()) out.insert(peer.name);
  return out;
}

std::string PeerTable::name_of(const PeerId& id) const {
  const auto found = peers_.find(id);
  return found == peers_.end() || found->second.name.empty() ? "unknown" : found->second.name;
}

bool PeerTable::reaches(const std::string& name) const {
  return std::any_of(peers_.begin(), peers_.end(), [&](const auto& entry) {
    const Peer& peer = entry.second;
    return peer.name == name && peer.matches[static_cast<std::size_t>(Channel::kMessageOut)] > 0;
  });
}

bool PeerTable::matched_everywhere(const Peer& peer) {
  return std::all_of(peer.matches.begin(), peer.matches.end(), [](int count) { return count > 0; });
}

std::vector<HeardPeer> PeerTable::heard() const {
  std::vector<HeardPeer> out;
  for (const auto& [id, peer] : peers_)
    if (matched_everywhere(peer))
      out.push_back({token(id), peer.status_sent_ns, peer.status_received_ns});
  return out;
}

std::set<std::string> PeerTable::linked(std::uint64_t own_token) const {
  std::set<std::string> out;
  for (const auto& [id, peer] : peers_)
    if (is_linked(peer, own_token)) out.insert(peer.name);
  return out;
}

std::set<in_addr_t> PeerTable::linked_addresses(std::uint64_t own_token) const {
  std::set<in_addr_t> out;
  for (const auto& [id, peer] : peers_)
    if (is_linked(peer, own_token)) out.insert(peer.address);
  return out;
}

bool PeerTable::is_linked(const PeerId& id, std::uint64_t own_token) const {
  const auto found = peers_.find(id);
  return found != peers_.end() && is_linked(found->second, own_token);
}

bool PeerTable::is_linked(const Peer& peer, std::uint64_t own_token) {
  const bool hears_us =
      std::find(peer.hears.begin(), peer.hears.end(), own_token) != peer.hears.end();
  return !peer.name.empty() && peer.alive && hears_us && matched_everywhere(peer);
}

}  // namespace covey
