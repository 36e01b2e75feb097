// SPDX-License-Identifier: Apache-2.0
#include "estimator/imu_buffer.h"

#include <algorithm>

namespace covey {
namespace {

bool earlier(const ImuSample& sample, TimeNs stamp_ns) { return sample.stamp_ns < stamp_ns; }

}  // namespace

ImuBuffer::Added ImuBuffer::add(const ImuSample& sample, double max_gyro, double max_accel) {
  const bool finite = sample.gyro_imu.allFinite() && sample.accel_imu.allFinite();
  if (!finite || sample.gyro_imu.norm() > max_gyro || sample.accel_imu.norm() > max_accel) {
    return Added::kInvalid;
  }
  if (!samples_.empty() && sample.stamp_ns <= samples_.back().stamp_ns) return Added::kOutOfOrder;
  samples_.push_back(sample);
  return Added::kYes;
}

bool ImuBuffer::covers(TimeNs stamp_ns) const {
  return !samples_.empty() && samples_.back().stamp_ns >= stamp_ns;
}

std::optional<ImuSample> ImuBuffer::at(TimeNs stamp_ns) const {
  if (samples_.empty()) return std::nullopt;
  const auto later = std::lower_bound(samples_.begin(), samples_.end(), stamp_ns, earlier);
  if (later != samples_.begin() && later != samples_.end()) {
    return interpolate(*(later - 1), *later, stamp_ns);
  }
  const ImuSample& held = later == samples_.begin() ? samples_.front() : samples_.back();
  return ImuSample{stamp_ns, held.gyro_imu, held.accel_imu};
}

ImuInterval ImuBuffer::between(TimeNs from_ns, TimeNs to_ns) const {
  const auto after = [&](TimeNs stamp_ns) {
    return std::lower_bound(samples_.begin(), samples_.end(), stamp_ns, earlier);
  };
  // Between the measured samples around a moment; before the first one from that moment on.
  const auto span_s = [&](auto later, TimeNs moment_ns) {
    const TimeNs begin_ns = later == samples_.begin() ? moment_ns : (later - 1)->stamp_ns;
    return seconds_between(begin_ns, later->stamp_ns);
  };
  ImuInterval interval;
  interval.first_span_s = span_s(after(from_ns + 1), from_ns);
  interval.last_span_s = span_s(after(to_ns), from_ns);
  interval.samples.push_back(*at(from_ns));
  for (auto next = after(from_ns + 1); next->stamp_ns < to_ns; ++next)
    interval.samples.push_back(*next);
  interval.samples.push_back(*at(to_ns));
  return interval;
}

ImuInterval ImuBuffer::since(TimeNs from_ns) const {
  return between(from_ns, samples_.back().stamp_ns);
}

int ImuBuffer::gaps_ending(TimeNs from_ns, TimeNs to_ns, double max_gap_s) const {
  int gaps = 0;
  for (auto later = std::lower_bound(samples_.begin(), samples_.end(), from_ns + 1, earlier);
       later != samples_.end() && later->stamp_ns <= to_ns; ++later) {
    const TimeNs begin_ns = later == samples_.begin() ? from_ns : (later - 1)->stamp_ns;
    if (seconds_between(begin_ns, later->stamp_ns) > max_gap_s) ++gaps;
  }
  return gaps;
}

std::vector<ImuSample> ImuBuffer::last(TimeNs to_ns, double window_s) const {
  const auto begin =
      std::lower_bound(samples_.begin(), samples_.end(), to_ns - nanoseconds(window_s), earlier);
  const auto end = std::lower_bound(samples_.begin(), samples_.end(), to_ns + 1, earlier);
  return begin < end ? std::vector<ImuSample>(begin, end) : std::vector<ImuSample>{};
}

void ImuBuffer::forget_before(TimeNs stamp_ns) {
  while (samples_.size() > 1 && samples_[1].stamp_ns <= stamp_ns) samples_.pop_front();
}

}  // namespace covey
