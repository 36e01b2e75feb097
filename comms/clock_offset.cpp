// SPDX-License-Identifier: Apache-2.0
#include "comms/clock_offset.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>

#include "comms/checks.h"

namespace covey {
namespace {

constexpr std::size_t kWindow = 8;                  // round trips
constexpr TimeNs kMaxRoundTripNs = 10'000'000'000;  // what is older says nothing of now
constexpr double kMaxDrift = 2e-4;                  // s/s, between two poor quartzes

// Differences of two stamps, and sums of two differences, stay below 2^63.
static_assert(2 * kMaxStampNs <= std::numeric_limits<TimeNs>::max());

// 0: none was said.
bool is_reading(TimeNs stamp_ns) { return stamp_ns != 0 && is_stamp(stamp_ns); }

// What two clocks may drift apart meanwhile.
TimeNs drift_ns(TimeNs span_ns) {
  return static_cast<TimeNs>(kMaxDrift * std::abs(static_cast<double>(span_ns)));
}

}  // namespace

TimeNs wall_clock_ns() {
  const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(since_1970).count();
}

std::optional<ClockOffset> clock_offset(const RoundTrip& trip) {
  for (const TimeNs stamp_ns : {trip.sent_ns, trip.heard_ns, trip.answered_ns, trip.received_ns})
    if (!is_reading(stamp_ns)) return std::nullopt;
  const TimeNs away_ns = trip.received_ns - trip.sent_ns;
  const TimeNs there_ns = trip.answered_ns - trip.heard_ns;
  if (away_ns < 0 || there_ns < 0) return std::nullopt;
  const TimeNs on_the_way_ns = away_ns - there_ns;
  if (on_the_way_ns < -drift_ns(there_ns) || on_the_way_ns > kMaxRoundTripNs) return std::nullopt;
  const TimeNs twice_ns = (trip.heard_ns - trip.sent_ns) + (trip.answered_ns - trip.received_ns);
  return ClockOffset{twice_ns / 2, std::max<TimeNs>(on_the_way_ns, 0)};
}

bool ClockFilter::add(const RoundTrip& trip) {
  const auto offset = clock_offset(trip);
  if (!offset) return false;
  const Sample sample{*offset, trip.received_ns};
  if (!samples_.empty() && contradict(fastest(), sample)) samples_.clear();
  samples_.push_back(sample);
  if (samples_.size() > kWindow) samples_.pop_front();
  return true;
}

bool ClockFilter::contradict(const Sample& a, const Sample& b) {
  const TimeNs sure_to_ns = (a.offset.round_trip_ns + b.offset.round_trip_ns) / 2;
  const TimeNs apart_ns = a.offset.offset_ns - b.offset.offset_ns;
  return std::abs(apart_ns) > sure_to_ns + drift_ns(a.taken_ns - b.taken_ns);
}

const ClockFilter::Sample& ClockFilter::fastest() const {
  return *std::min_element(samples_.begin(), samples_.end(), [](const auto& a, const auto& b) {
    return a.offset.round_trip_ns < b.offset.round_trip_ns;
  });
}

std::optional<ClockOffset> ClockFilter::best() const {
  if (samples_.empty()) return std::nullopt;
  return fastest().offset;
}

}  // namespace covey
