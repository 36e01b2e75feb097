// SPDX-License-Identifier: Apache-2.0
#include "apps/sensor_clocks.h"

namespace covey {
namespace {

constexpr double kMostApart_s = 1;

}  // namespace

std::optional<double> SensorClocks::see_image(TimeNs stamp_ns, double now_ms) {
  image_ = {stamp_ns, now_ms};
  const double ahead_s = images_ahead_s();
  return ahead_s < -kMostApart_s ? std::optional(ahead_s) : std::nullopt;
}

std::optional<double> SensorClocks::see_imu(TimeNs newest_ns, double now_ms) {
  imu_ = {newest_ns, now_ms};
  const double ahead_s = images_ahead_s();
  return ahead_s > kMostApart_s ? std::optional(ahead_s) : std::nullopt;
}

bool SensorClocks::waits_in_vain(double now_ms) const {
  constexpr double kPatience_ms = 1000, kSilence_ms = 500;
  return images_ahead_s() > kMostApart_s && now_ms - image_->came_ms > kPatience_ms &&
         now_ms - imu_->came_ms < kSilence_ms;
}

double SensorClocks::images_ahead_s() const {
  return image_ && imu_ ? seconds_between(imu_->stamp_ns, image_->stamp_ns) : 0;
}

}  // namespace covey
