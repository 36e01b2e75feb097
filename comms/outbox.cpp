// SPDX-License-Identifier: Apache-2.0
#include "comms/outbox.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "comms/checks.h"

namespace covey {
namespace {

constexpr std::size_t kMaxWaiting = 64;
// Names come from the network, and any number of them may come and go. More than there are drones
// to be answered at once: who is forgotten has been sent nothing for long.
constexpr std::size_t kMaxReceivers = 2 * kMaxHears;
constexpr std::size_t kMaxHeld = 64;     // keyframes remembered per peer
constexpr double kGoodDepthSigma = 0.1;  // relative; a landmark's depth this good counts half
constexpr double kRequestWorth = 20;     // half of a usual answer, which it may bring
constexpr double kFoundWorth = 40;       // what came of an answer: about as much as that told
constexpr double kHeldShare = 0.25;      // what a keyframe is still worth to who has it
constexpr double kDatagramOverheadBytes = 100;  // RTPS, UDP and IP headers, and a heartbeat
// What has not gone out by then never will: a peer has left, or a datagram cost less than it may.
constexpr std::chrono::seconds kOnTheWire{1};

const char* name_of(Kind kind) {
  switch (kind) {
    case Kind::kRequest:
      return "request";
    case Kind::kMessage:
    case Kind::kFullMessage:
      return "message";
    case Kind::kStatus:
      return "status";
    case Kind::kOdometry:
      break;
  }
  return "odometry";
}

double cost(const Outgoing& out) {
  return static_cast<double>(out.bytes.size()) + kDatagramOverheadBytes;
}

void remember(std::uint64_t keyframe_id, std::deque<std::uint64_t>* held) {
  held->push_back(keyframe_id);
  if (held->size() > kMaxHeld) held->pop_front();
}

std::size_t copies_for_all(Kind kind, const Audience& audience) {
  return kind == Kind::kOdometry ? audience.listeners : audience.peers;
}

}  // namespace

double worth(const PlaceAdvert& /*advert*/) { return kRequestWorth; }

double worth(const PeerKeyframe& keyframe) {
  if (keyframe.found) return kFoundWorth;
  double sum = 0;
  for (const PeerLandmark& landmark : keyframe.landmarks) {
    const double sigma = landmark.inverse_depth_sigma / landmark.inverse_depth / kGoodDepthSigma;
    sum += 1 / (1 + sigma * sigma);
  }
  return sum;
}

double worth(const Odometry& /*odometry*/) { return 1; }

Outbox::Outbox(const LoadProfile& load)
    : load_(load),
      unlimited_(load.drone_bytes_per_s == 0 && load.link_bytes_per_s == 0),
      drone_(load.drone_bytes_per_s, load.drone_burst_bytes) {}

void Outbox::drop(const Place& place, const std::string& reason) {
  ++dropped_[std::string(name_of(place->out.kind)) + " " + reason];
  waiting_.erase(place);
}

// An odometry replaces the one before: only the newest is of use.
void Outbox::offer(Outgoing out, Time now) {
  const auto same = std::find_if(waiting_.begin(), waiting_.end(), [&](const Waiting& waiting) {
    return out.kind == Kind::kOdometry && waiting.out.kind == Kind::kOdometry;
  });
  if (same != waiting_.end()) drop(same, "replaced by a newer one");
  waiting_.push_back({std::move(out), now, false});
  if (waiting_.size() <= kMaxWaiting) return;
  drop(std::min_element(waiting_.begin(), waiting_.end(),
                        [&](const Waiting& a, const Waiting& b) {
                          return usefulness(a, now) < usefulness(b, now);
                        }),
       "less useful than others");
}

// Only who has found no room: without any patience all would be late before it was looked for.
void Outbox::drop_late(Time now) {
  const auto is_late = [&](const Waiting& waiting) {
    return waiting.found_no_room &&
           now - waiting.since > std::chrono::milliseconds(load_.patience_ms);
  };
  for (auto late = std::find_if(waiting_.begin(), waiting_.end(), is_late); late != waiting_.end();
       late = std::find_if(waiting_.begin(), waiting_.end(), is_late))
    drop(late, "found no room in time");
}

// A falling keyframe id tells a hearer that the sender has started anew: it would forget the
// sender's world. So no question may follow a newer one. Making the newer one wait instead gets
// about as many through a full radio, but old ones: each would have waited for all its patience.
void Outbox::drop_questions_before(std::ptrdiff_t place) {
  while (place-- > 0)
    if (waiting_[static_cast<std::size_t>(place)].out.kind == Kind::kRequest)
      drop(waiting_.begin() + place, "overtaken by a newer one");
}

// Per byte, halved with every half of the patience, and less to who has the keyframe already.
double Outbox::usefulness(const Waiting& waiting, Time now) const {
  const Outgoing& out = waiting.out;
  const double age_ms = std::chrono::duration<double, std::milli>(now - waiting.since).count();
  const double half_life_ms = std::max(1.0, 0.5 * load_.patience_ms);
  double share = 1;
  if (!out.receivers.empty()) {
    const auto holders =
        std::count_if(out.receivers.begin(), out.receivers.end(),
                      [&](const std::string& peer) { return holds(peer, out.keyframe_id); });
    share -=
        (1 - kHeldShare) * static_cast<double>(holders) / static_cast<double>(out.receivers.size());
  }
  return share * out.worth / cost(out) * std::exp2(-age_ms / half_life_ms);
}

std::set<std::string> Outbox::receivers_with_room(const Outgoing& out, Time now) {
  std::set<std::string> with_room;
  for (const std::string& peer : out.receivers)
    if (link_has_room(peer, cost(out), now)) with_room.insert(peer);
  return with_room;
}

bool Outbox::may_go(const Outgoing& out, const Audience& audience, Time now) {
  if (out.receivers.empty()) {
    const std::size_t copies = std::max<std::size_t>(copies_for_all(out.kind, audience), 1);
    return drone_.has(cost(out) * static_cast<double>(copies), now);
  }
  const std::size_t copies = receivers_with_room(out, now).size();
  return copies > 0 && drone_.has(cost(out) * static_cast<double>(copies), now);
}

std::optional<Outgoing> Outbox::next(std::uint64_t wire_bytes, const Audience& audience, Time now) {
  spend_drone(static_cast<double>(wire_bytes - std::exchange(wire_bytes_, wire_bytes)), now);
  drop_late(now);
  Place best = waiting_.end();
  for (Place place = waiting_.begin(); place != waiting_.end(); ++place) {
    if (!may_go(place->out, audience, now)) continue;
    if (best == waiting_.end() || usefulness(*place, now) >= usefulness(*best, now)) best = place;
  }
  if (best == waiting_.end()) {
    for (Waiting& waiting : waiting_) waiting.found_no_room = true;
    return std::nullopt;
  }
  Outgoing out = std::move(best->out);
  best = waiting_.erase(best);
  if (out.kind == Kind::kRequest) drop_questions_before(best - waiting_.begin());
  const std::set<std::string> with_room = receivers_with_room(out, now);
  if (const std::size_t left_out = out.receivers.size() - with_room.size(); left_out > 0)
    dropped_[std::string(name_of(out.kind)) + " found no room in time"] += left_out;
  out.receivers = with_room;
  spend(out, with_room.empty() ? copies_for_all(out.kind, audience) : with_room.size(), now);
  return out;
}

// How much of it was let go here.
double Outbox::pay(double wire_bytes, Time now) {
  while (!unpaid_.empty() && now - unpaid_.front().since > kOnTheWire) unpaid_.pop_front();
  double left = wire_bytes;
  for (; !unpaid_.empty() && left >= unpaid_.front().bytes; unpaid_.pop_front())
    left -= unpaid_.front().bytes;
  if (unpaid_.empty()) return wire_bytes - left;
  unpaid_.front().bytes -= left;
  return wire_bytes;
}

// What really goes out, whoever sent it: DDS finds peers and repairs by itself.
void Outbox::spend_drone(double wire_bytes, Time now) {
  const double own = pay(wire_bytes, now);
  drone_.spend(own, now);
  drone_.spend_unasked(wire_bytes - own, now);
}

// The drone's own budget pays when next() hears of it.
void Outbox::spend(const Outgoing& out, std::size_t copies, Time now) {
  if (copies > 0) unpaid_.push_back({cost(out) * static_cast<double>(copies), now});
  for (const std::string& peer : out.receivers) {
    Receiver& receiver = receiver_named(peer, now);
    receiver.link.spend(cost(out), now);
    if (out.keyframe_id != 0) remember(out.keyframe_id, &receiver.held);
  }
}

// Who was sent nothing yet, or is forgotten, has a full bucket, which has room for anything.
bool Outbox::link_has_room(const std::string& peer, double bytes, Time now) {
  const auto known = receivers_.find(peer);
  return known == receivers_.end() || known->second.link.has(bytes, now);
}

Outbox::Receiver& Outbox::receiver_named(const std::string& peer, Time now) {
  if (receivers_.size() >= kMaxReceivers && receivers_.count(peer) == 0)
    receivers_.erase(std::min_element(
        receivers_.begin(), receivers_.end(),
        [](const auto& a, const auto& b) { return a.second.last_sent < b.second.last_sent; }));
  Receiver fresh{
      {static_cast<double>(load_.link_bytes_per_s), static_cast<double>(load_.link_burst_bytes)}};
  Receiver& receiver = receivers_.try_emplace(peer, std::move(fresh)).first->second;
  receiver.last_sent = now;
  return receiver;
}

bool Outbox::holds(const std::string& peer, std::uint64_t keyframe_id) const {
  const auto known = receivers_.find(peer);
  if (known == receivers_.end()) return false;
  const std::deque<std::uint64_t>& held = known->second.held;
  return std::find(held.begin(), held.end(), keyframe_id) != held.end();
}

}  // namespace covey
