// SPDX-License-Identifier: Apache-2.0
#include "estimator/imu_buffer.h"

#include <algorithm>
#include <limits>

#include "estimator/imu_increment.h"

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

std::vector<ImuSample> ImuBuffer::between(TimeNs from_ns, TimeNs to_ns, double max_gap_s,
                                          int& gaps) const {
  std::vector<ImuSample> result;
  const auto at = [&](TimeNs stamp_ns) {
    const auto after = std::lower_bound(samples_.begin(), samples_.end(), stamp_ns, earlier);
    if (after == samples_.begin()) return ImuSample{stamp_ns, after->gyro_imu, after->accel_imu};
    return interpolate(*(after - 1), *after, stamp_ns);
  };
  result.push_back(at(from_ns));
  auto next = std::lower_bound(samples_.begin(), samples_.end(), from_ns + 1, earlier);
  for (; next != samples_.end() && next->stamp_ns < to_ns; ++next) result.push_back(*next);
  result.push_back(at(to_ns));
  for (std::size_t i = 1; i < result.size(); ++i) {
    if (seconds_between(result[i - 1].stamp_ns, result[i].stamp_ns) > max_gap_s) ++gaps;
  }
  return result;
}

std::vector<ImuSample> ImuBuffer::since(TimeNs from_ns) const {
  int gaps = 0;
  return between(from_ns, samples_.back().stamp_ns, std::numeric_limits<double>::infinity(), gaps);
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
