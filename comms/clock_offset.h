// SPDX-License-Identifier: Apache-2.0
//
// How far a peer's wall clock is ahead of the own one, from statuses that go both ways as NTP's
// packets do: each says when it was sent, and when the newest status of the other was sent and
// came. Nothing is set by it: people are told. Pure: no DDS, and the clock is the caller's.
#pragma once

#include <cstddef>
#include <deque>
#include <functional>
#include <optional>

#include "estimator/measurements.h"

namespace covey {

// Nanoseconds since 1970. Any moment may be asked for from any thread.
using WallClock = std::function<TimeNs()>;
[[nodiscard]] TimeNs wall_clock_ns();

// The way of a status to the peer and of the peer's next one back.
struct RoundTrip {
  TimeNs sent_ns = 0;      // T1, own clock
  TimeNs heard_ns = 0;     // T2, peer's clock
  TimeNs answered_ns = 0;  // T3, peer's clock
  TimeNs received_ns = 0;  // T4, own clock
};

struct ClockOffset {
  TimeNs offset_ns = 0;      // the peer's clock minus the own one, sure to half the round trip
  TimeNs round_trip_ns = 0;  // both ways, without the time in between; at least 0
};

// What one round trip says (RFC 5905, section 8). Nothing if no two clocks can have read so: a
// stamp that is none, an end before its beginning, or more than 10 s on the way.
[[nodiscard]] std::optional<ClockOffset> clock_offset(const RoundTrip& trip);

// Of the newest eight round trips the fastest: what waits on the way, waits on one way (RFC 5905,
// section 10). A trip that contradicts it, both being sure to half their length, means that one of
// the clocks was set: what came before is forgotten. Not thread-safe.
class ClockFilter {
 public:
  // False: not plausible, nothing changes.
  bool add(const RoundTrip& trip);

  [[nodiscard]] std::optional<ClockOffset> best() const;

 private:
  struct Sample {
    ClockOffset offset;
    TimeNs taken_ns = 0;  // own clock
  };
  static bool contradict(const Sample& a, const Sample& b);
  [[nodiscard]] const Sample& fastest() const;

  std::deque<Sample> samples_;
};

}  // namespace covey
