// SPDX-License-Identifier: Apache-2.0
#include "apps/flight_time.h"

#include <algorithm>

namespace covey {

FlightTime::FlightTime(double duration_s, TimeNs first_ns, double now_ms)
    : duration_s_(duration_s), newest_ns_(first_ns), begun_ms_(now_ms), newest_ms_(now_ms) {}

// Recordings may be played faster than they were flown, but images come more often than once a
// second: a longer step is a gap, or a clock that was set.
void FlightTime::see_image(TimeNs stamp_ns, double now_ms) {
  const TimeNs passed_ns = nanoseconds(1e-3 * (now_ms - newest_ms_));
  flown_ns_ += std::min(stamp_ns - newest_ns_, std::max(nanoseconds(1), passed_ns));
  newest_ns_ = stamp_ns;
  newest_ms_ = now_ms;
}

bool FlightTime::is_over(double now_ms) const {
  constexpr double kSilence_ms = 1000;
  if (duration_s_ == 0) return false;
  if (flown_s() > duration_s_) return true;
  return now_ms - begun_ms_ > 1e3 * duration_s_ && now_ms - newest_ms_ > kSilence_ms;
}

}  // namespace covey
