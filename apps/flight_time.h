// SPDX-License-Identifier: Apache-2.0
//
// How long a drone has flown, by the stamps of its images: when agent.duration_s is over. A step of
// more than a second, as when their clock is set forward, counts as one or as what has passed by
// this computer's clock, which is passed in, ms.
#pragma once

#include "estimator/measurements.h"

namespace covey {

class FlightTime {
 public:
  FlightTime(double duration_s, TimeNs first_ns, double now_ms);  // 0 s: without an end

  void see_image(TimeNs stamp_ns, double now_ms);
  [[nodiscard]] double flown_s() const { return seconds_between(0, flown_ns_); }
  // By this computer's clock once no more images come.
  [[nodiscard]] bool is_over(double now_ms) const;

 private:
  double duration_s_ = 0;
  TimeNs newest_ns_ = 0, flown_ns_ = 0;
  double begun_ms_ = 0, newest_ms_ = 0;
};

}  // namespace covey
