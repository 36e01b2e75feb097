// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <deque>
#include <optional>
#include <vector>

#include "estimator/imu_increment.h"
#include "estimator/measurements.h"

namespace covey {

// IMU samples in time order, integrated or not: as many as its owner does not let it forget.
class ImuBuffer {
 public:
  enum class Added { kYes, kOutOfOrder, kInvalid };

  // Refuses samples that are not finite, beyond the limits, or not later than the last one.
  Added add(const ImuSample& sample, double max_gyro, double max_accel);

  [[nodiscard]] bool covers(TimeNs stamp_ns) const;

  // Interpolated; held before the first sample and after the last. None without any.
  [[nodiscard]] std::optional<ImuSample> at(TimeNs stamp_ns) const;
  // From `from_ns` to `to_ns`, both ends interpolated (held before the first sample). Needs
  // covers(to_ns) and from_ns < to_ns.
  [[nodiscard]] ImuInterval between(TimeNs from_ns, TimeNs to_ns) const;
  // Up to the newest sample. Needs covers(from_ns + 1).
  [[nodiscard]] ImuInterval since(TimeNs from_ns) const;
  // How often neighbours are further apart than `max_gap_s`, the later one in (from_ns, to_ns]; the
  // first one of all counts from `from_ns`.
  [[nodiscard]] int gaps_ending(TimeNs from_ns, TimeNs to_ns, double max_gap_s) const;
  // Samples of the last `window_s` before `to_ns`.
  [[nodiscard]] std::vector<ImuSample> last(TimeNs to_ns, double window_s) const;

  void forget_before(TimeNs stamp_ns);  // keeps one sample before it, to interpolate from

 private:
  std::deque<ImuSample> samples_;
};

}  // namespace covey
