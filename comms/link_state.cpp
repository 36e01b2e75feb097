// SPDX-License-Identifier: Apache-2.0
#include "comms/link_state.h"

#include <algorithm>
#include <utility>

#include "comms/checks.h"

namespace covey {
namespace {

// Twice what fits into a status: drones that come back are other ones until their ghosts have gone.
constexpr std::size_t kMaxPeers = 2 * kMaxHears;
static_assert(kMaxAgents <= static_cast<int>(kMaxHears) / 2,
              "a status must name all that are heard");
// A newcomer may have to be told of this drone more than once before both are linked.
constexpr std::chrono::seconds kWelcome{5};
// Who has not got on for so long is no drone, or not within reach.
constexpr std::chrono::seconds kPatience{2};

bool same(const AgentStatus& a, const AgentStatus& b) {
  return a.agent == b.agent && a.stamp_ns == b.stamp_ns && a.status == b.status &&
         a.frames == b.frames && a.tracks == b.tracks && a.keyframes == b.keyframes;
}

std::vector<std::uint64_t> tokens(const std::vector<HeardPeer>& peers) {
  std::vector<std::uint64_t> out(peers.size());
  std::transform(peers.begin(), peers.end(), out.begin(),
                 [](const HeardPeer& peer) { return peer.token; });
  return out;
}

const PeerKeyframe& keyframe_of(const PeerKeyframe& message) { return message; }
const PeerKeyframe& keyframe_of(const FullPeerKeyframe& message) { return message.keyframe; }

}  // namespace

LinkState::LinkState(std::string agent, std::size_t inbox_limit, const TeamWatch& watch,
                     WallClock clock)
    : agent_(std::move(agent)),
      inbox_limit_(inbox_limit),
      watch_(watch),
      clock_(std::move(clock)),
      table_(kMaxPeers) {}

void LinkState::set_own_id(const PeerId& id) {
  const std::lock_guard lock(mutex_);
  own_id_ = id;
}

bool LinkState::is_own(const PeerId& id) const {
  const std::lock_guard lock(mutex_);
  return id == own_id_;
}

// ------------------------------------------------------------------------------------- from DDS

void LinkState::receive(Kind kind, const Bytes& bytes, const PeerId& from) {
  if (is_own(from)) return;
  switch (kind) {
    case Kind::kRequest:
      return receive_request(bytes, from);
    case Kind::kMessage:
      return receive_message(decode_peer_keyframe(bytes), bytes.size(), from);
    case Kind::kFullMessage:
      return receive_message(decode_full_keyframe(bytes), bytes.size(), from);
    case Kind::kStatus:
      return receive_status(bytes, from);
    case Kind::kOdometry:
      return;  // for ground stations: no drone reads it
  }
}

void LinkState::receive_request(const Bytes& bytes, const PeerId& from) {
  Decoded<PlaceAdvert> decoded = decode_place_advert(bytes);
  const std::lock_guard lock(mutex_);
  ++arrived_.requests;
  if (const auto* rejected = std::get_if<Rejected>(&decoded))
    reject_locked(from, rejected->reason);
  else if (std::get<PlaceAdvert>(decoded).sender == agent_)
    reject_locked(from, kNamesake);
  else
    accept(&statistics_.request, bytes.size(), std::get<PlaceAdvert>(std::move(decoded)));
  changed_.notify_all();
}

template <typename Message>
void LinkState::receive_message(Decoded<Message> decoded, std::size_t bytes, const PeerId& from) {
  const std::lock_guard lock(mutex_);
  ++arrived_.messages;
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) {
    reject_locked(from, rejected->reason);
  } else {
    const PeerKeyframe& keyframe = keyframe_of(std::get<Message>(decoded));
    if (keyframe.sender == agent_)
      reject_locked(from, kNamesake);
    else if (keyframe.receiver != agent_ && !keyframe.receiver.empty())
      reject_locked(from, "meant for another drone");
    else
      accept(&statistics_.message, bytes, std::get<Message>(std::move(decoded)));
  }
  changed_.notify_all();
}

// A status is repeated when only its list of peers changed; the inbox sees each state once.
void LinkState::receive_status(const Bytes& bytes, const PeerId& from) {
  const TimeNs received_ns = clock_();
  Decoded<StatusSample> decoded = decode_status(bytes);
  const std::lock_guard lock(mutex_);
  if (const auto* rejected = std::get_if<Rejected>(&decoded))
    return reject_locked(from, rejected->reason);
  const StatusSample& sample = std::get<StatusSample>(decoded);
  const AgentStatus& status = sample.status;
  if (status.agent == agent_) return reject_locked(from, kNamesake);

  table_.set_hears(from, tokens(sample.hears));
  table_.set_status_stamps(from, sample.sent_ns, received_ns);
  compare_clocks(sample, received_ns);
  peers_changed_ = true;
  const auto last = last_status_.find(status.agent);
  if (last == last_status_.end() || !same(last->second, status)) {
    if (last_status_.size() < kMaxPeers || last != last_status_.end())
      last_status_[status.agent] = status;
    accept(&statistics_.status, bytes.size(), status);
  }
  changed_.notify_all();
}

// With what the peer says of the newest status of this drone, the way there and back is known.
void LinkState::compare_clocks(const StatusSample& sample, TimeNs received_ns) {
  const auto of_this_drone =
      std::find_if(sample.hears.begin(), sample.hears.end(),
                   [this](const HeardPeer& heard) { return heard.token == token(own_id_); });
  if (of_this_drone == sample.hears.end()) return;
  const std::string& peer = sample.status.agent;
  if (clocks_.size() >= kMaxPeers && clocks_.count(peer) == 0) return;
  clocks_[peer].add(
      {of_this_drone->sent_ns, of_this_drone->received_ns, sample.sent_ns, received_ns});
}

void LinkState::accept(KindStatistics* kind, std::size_t bytes, Inbound inbound) {
  ++kind->received;
  kind->payload_bytes_received += bytes;
  if (inbox_.size() >= inbox_limit_) {
    inbox_.pop_front();
    ++statistics_.inbox_dropped;
  }
  inbox_.push_back(std::move(inbound));
}

void LinkState::reject(const PeerId& from, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  reject_locked(from, reason);
}

void LinkState::reject_locked(const PeerId& from, const std::string& reason) {
  const std::string peer = table_.name_of(from);
  const bool room = statistics_.rejected.size() < kMaxPeers || statistics_.rejected.count(peer) > 0;
  ++statistics_.rejected[room ? peer : "unknown"][reason];
}

void LinkState::change_peers(const std::function<void(PeerTable&)>& change) {
  const std::lock_guard lock(mutex_);
  change(table_);
  peers_changed_ = true;
  changed_.notify_all();
}

void LinkState::name_peer(const PeerId& id, const std::string& name) {
  change_peers([&](PeerTable& table) { table.set_name(id, name); });
}

void LinkState::change_matches(const PeerId& id, Channel channel, int difference, Time now) {
  if (is_own(id)) return;
  change_peers([&](PeerTable& table) {
    table.change_matches(id, channel, difference);
    const auto participant = participants_.find(id);
    if (difference > 0 && participant != participants_.end()) participant->second = now;
  });
}

void LinkState::enter_participant(const PeerId& id, Time now) {
  change_peers([&](PeerTable& /*table*/) { participants_.emplace(id, now); });
}

void LinkState::remove_participant(const PeerId& id) {
  change_peers([&](PeerTable& table) {
    table.remove(id);
    participants_.erase(id);
  });
}

void LinkState::hear(const Packet& packet, Time now) {
  const std::lock_guard lock(mutex_);
  if (packet.sender == own_id_) return;
  if (participants_.count(packet.sender) == 0) newcomer_ = now;
  if (packet.announces || !table_.hear(packet, now)) return;
  peers_changed_ = true;
  changed_.notify_all();
}

bool LinkState::complete(Time now) const {
  const std::lock_guard lock(mutex_);
  if (now - newcomer_ <= kWelcome) return false;
  if (watch_.others.empty()) {
    const std::size_t all = table_.linked(token(own_id_)).size() + 1;
    return watch_.team_size > 0 && all >= static_cast<std::size_t>(watch_.team_size);
  }
  const std::set<in_addr_t> linked = table_.linked_addresses(token(own_id_));
  return std::includes(linked.begin(), linked.end(), watch_.others.begin(), watch_.others.end());
}

LinkState::Waiting LinkState::waiting(Time now) const {
  const std::lock_guard lock(mutex_);
  Waiting waiting;
  waiting.participants = static_cast<int>(participants_.size());
  for (const auto& [id, progress] : participants_) {
    if (now - progress > kPatience || table_.is_linked(id, token(own_id_))) continue;
    waiting.since = std::min(waiting.since, progress);
  }
  return waiting;
}

// ------------------------------------------------------------------------------ from the caller

std::vector<Inbound> LinkState::take() {
  const std::lock_guard lock(mutex_);
  std::vector<Inbound> out(std::make_move_iterator(inbox_.begin()),
                           std::make_move_iterator(inbox_.end()));
  inbox_.clear();
  return out;
}

std::set<std::string> LinkState::peers() const {
  const std::lock_guard lock(mutex_);
  return table_.linked(token(own_id_));
}

bool LinkState::reaches(const std::string& receiver) const {
  const std::lock_guard lock(mutex_);
  return table_.reaches(receiver);
}

ArrivalCounts LinkState::arrived() const {
  const std::lock_guard lock(mutex_);
  return arrived_;
}

LinkStatistics LinkState::statistics() const {
  const std::lock_guard lock(mutex_);
  LinkStatistics statistics = statistics_;
  for (const auto& [peer, clock] : clocks_)
    if (const auto best = clock.best()) statistics.clocks[peer] = *best;
  return statistics;
}

KindStatistics& LinkState::statistics_of(Kind kind) {
  switch (kind) {
    case Kind::kRequest:
      return statistics_.request;
    case Kind::kMessage:
    case Kind::kFullMessage:
      return statistics_.message;
    case Kind::kStatus:
      return statistics_.status;
    case Kind::kOdometry:
      break;
  }
  return statistics_.odometry;
}

void LinkState::count_sent(Kind kind, std::size_t bytes) {
  const std::lock_guard lock(mutex_);
  KindStatistics& statistics = statistics_of(kind);
  ++statistics.sent;
  statistics.payload_bytes_sent += bytes;
}

void LinkState::count_message_to(const std::string& receiver) {
  const std::lock_guard lock(mutex_);
  count_one(receiver, &statistics_.messages_sent_to);
}

void LinkState::count_refused(Kind kind, const std::string& reason) {
  const std::lock_guard lock(mutex_);
  ++statistics_of(kind).refused;
  ++statistics_.refused[reason];
}

// ---------------------------------------------------------------------------------------- waits

bool LinkState::wait_for_peers(const PeersTest& enough, Duration timeout) {
  std::unique_lock lock(mutex_);
  const auto ready = [&] { return enough(table_.linked(token(own_id_))); };
  changed_.wait_for(lock, timeout, [&] { return closed_ || ready(); });
  return ready();
}

bool LinkState::wait_for_inbox(const ArrivalCounts& at_least, Duration timeout) {
  std::unique_lock lock(mutex_);
  const auto ready = [&] {
    return arrived_.requests >= at_least.requests && arrived_.messages >= at_least.messages;
  };
  changed_.wait_for(lock, timeout, [&] { return closed_ || ready(); });
  return ready();
}

std::optional<LinkState::Housekeeping> LinkState::wait_for_housekeeping(Time until) {
  std::unique_lock lock(mutex_);
  const Time check =
      table_.next_check(watch_.silence, std::chrono::steady_clock::now()).value_or(until);
  changed_.wait_until(lock, std::min(until, check), [&] { return closed_ || peers_changed_; });
  if (closed_) return std::nullopt;
  peers_changed_ = false;
  const auto silence = table_.check_silence(watch_.silence, std::chrono::steady_clock::now());
  if (silence.gone) changed_.notify_all();
  return Housekeeping{table_.names(), tokens(table_.heard()), silence.doubt};
}

StatusSample LinkState::to_be_said(const AgentStatus& status) const {
  const std::lock_guard lock(mutex_);
  StatusSample sample{status, table_.heard()};
  if (sample.hears.size() > kMaxHears) sample.hears.resize(kMaxHears);
  sample.sent_ns = clock_();
  return sample;
}

void LinkState::close() {
  const std::lock_guard lock(mutex_);
  closed_ = true;
  changed_.notify_all();
}

}  // namespace covey
