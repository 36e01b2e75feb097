// SPDX-License-Identifier: Apache-2.0
//
// Whether stamps of camera and IMU are of one clock, as far as what has come tells. Images ahead of
// the IMU are found when its samples come, images behind it when they come themselves: what the
// other sensor said last may be old by then. This computer's clock is passed in, ms.
#pragma once

#include <optional>

#include "estimator/measurements.h"

namespace covey {

class SensorClocks {
 public:
  // Each returns by how many seconds images are ahead of the IMU (below zero: behind it), if that
  // is more than a second.
  std::optional<double> see_image(TimeNs stamp_ns, double now_ms);
  std::optional<double> see_imu(TimeNs newest_ns, double now_ms);

  // The newest image has waited for a second, and an IMU that speaks is still far behind it.
  [[nodiscard]] bool waits_in_vain(double now_ms) const;

 private:
  struct Seen {
    TimeNs stamp_ns = 0;
    double came_ms = 0;
  };
  [[nodiscard]] double images_ahead_s() const;  // 0 until both have spoken

  std::optional<Seen> image_, imu_;
};

}  // namespace covey
