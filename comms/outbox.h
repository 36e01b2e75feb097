// SPDX-License-Identifier: Apache-2.0
//
// What a drone wants to say and its radio has no room for yet. Token buckets say how much may go:
// one for all that the drone puts on the wire, repair and discovery included, and one for the
// answers to each peer. What brings a peer most per byte goes first; what has waited too long, or
// has become the least useful of too many, is dropped and counted; so is a question that a newer
// one has overtaken. So nothing is ever late by more than the profile's patience. No DDS, no clock
// of its own; not thread-safe. However many names peers have had, only the latest are remembered.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "comms/convert.h"
#include "comms/link_profile.h"
#include "comms/link_state.h"
#include "comms/token_bucket.h"

namespace covey {

struct Outgoing {
  Kind kind = Kind::kRequest;
  std::set<std::string> receivers;  // of a message; what is for all has none
  std::uint64_t keyframe_id = 0;    // whose landmarks a message holds, from 1; 0: it holds none
  double worth = 0;                 // what a peer may learn from it, in well-known landmarks
  Bytes bytes;
};

// A landmark counts in full when its depth is well known, and less the worse it is.
[[nodiscard]] double worth(const PlaceAdvert& advert);
[[nodiscard]] double worth(const PeerKeyframe& keyframe);
[[nodiscard]] double worth(const Odometry& odometry);

// Who hears what is for all.
struct Audience {
  std::size_t peers = 0;      // of questions
  std::size_t listeners = 0;  // of odometry
};

class Outbox {
 public:
  using Time = TokenBucket::Time;

  explicit Outbox(const LoadProfile& load);

  [[nodiscard]] bool unlimited() const { return unlimited_; }

  void offer(Outgoing out, Time now);

  // The most useful that both budgets have room for; its receivers are those whose budgets have.
  // `wire_bytes`: all that the drone has put on the wire so far.
  [[nodiscard]] std::optional<Outgoing> next(std::uint64_t wire_bytes, const Audience& audience,
                                             Time now);

  [[nodiscard]] bool empty() const { return waiting_.empty(); }
  // Dropped on purpose since the start, by kind and reason.
  [[nodiscard]] const std::map<std::string, std::uint64_t>& dropped() const { return dropped_; }

 private:
  struct Waiting {
    Outgoing out;
    Time since;
    bool found_no_room = false;  // when it was looked for
  };
  struct Receiver {
    TokenBucket link;
    std::deque<std::uint64_t> held{};  // keyframes that it was sent
    Time last_sent{};
  };
  using Place = std::deque<Waiting>::iterator;
  // Let go, and not on the wire yet.
  struct Unpaid {
    double bytes = 0;
    Time since;
  };

  void drop(const Place& place, const std::string& reason);
  void drop_late(Time now);
  void drop_questions_before(std::ptrdiff_t place);
  [[nodiscard]] double usefulness(const Waiting& waiting, Time now) const;
  [[nodiscard]] std::set<std::string> receivers_with_room(const Outgoing& out, Time now);
  [[nodiscard]] bool may_go(const Outgoing& out, const Audience& audience, Time now);
  [[nodiscard]] bool link_has_room(const std::string& peer, double bytes, Time now);
  Receiver& receiver_named(const std::string& peer, Time now);
  [[nodiscard]] bool holds(const std::string& peer, std::uint64_t keyframe_id) const;
  void spend(const Outgoing& out, std::size_t copies, Time now);
  [[nodiscard]] double pay(double wire_bytes, Time now);
  void spend_drone(double wire_bytes, Time now);

  const LoadProfile load_;
  const bool unlimited_;
  TokenBucket drone_;
  std::uint64_t wire_bytes_ = 0;
  std::deque<Unpaid> unpaid_;                  // the oldest first
  std::map<std::string, Receiver> receivers_;  // by name, those who were sent something lately
  std::deque<Waiting> waiting_;                // in the order of offering
  std::map<std::string, std::uint64_t> dropped_;
};

}  // namespace covey
