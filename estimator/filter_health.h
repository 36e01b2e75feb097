// SPDX-License-Identifier: Apache-2.0
//
// Whether the filter may be believed, and what to go back to when not.
#pragma once

#include <cstddef>
#include <optional>

#include "estimator/estimator.h"
#include "estimator/imu_increment.h"
#include "estimator/state.h"

namespace covey {

enum class Remedy {
  kNone,
  kLookAgain,  // the poses have become too uncertain for one linearisation
  kRestart,    // from the last healthy state, carried on by the IMU: the state itself is wrong
};

class FilterHealth {
 public:
  // A state that is believed.
  void begin(const State& state);

  // After an image whose tracks were used. Lost: in all images of seconds most features contradict
  // the state or updates fail, no feature is accepted though there are many, or the motion is
  // impossible.
  // `seeing`: the first visual update has been made. `interval`: what led to this image.
  [[nodiscard]] Remedy watch(const State& state, const UpdateReport& report, std::size_t tracks,
                             bool seeing, const std::optional<ImuInterval>& interval,
                             const EstimatorConfig& config);
  // An image to which the IMU alone has led.
  void pass(TimeNs stamp_ns, const ImuInterval& interval, const EstimatorConfig& config);
  // An image at which nothing is known.
  void miss(TimeNs stamp_ns);
  void restarted() { status_ = FilterStatus::kLost; }

  [[nodiscard]] FilterStatus status() const { return status_; }
  [[nodiscard]] TimeNs healthy_ns() const { return healthy_ns_; }
  // The state as it was then, carried on by the IMU alone; but for a velocity that cannot be, of
  // which nothing is known then.
  [[nodiscard]] CoreState fallback(const EstimatorConfig& config) const;

 private:
  void carry(const ImuInterval& interval, const EstimatorConfig& config);

  FilterStatus status_ = FilterStatus::kUninitialized;
  TimeNs healthy_ns_ = 0;
  std::optional<TimeNs> contradicted_since_ns_;  // in each image since then
  CoreState healthy_;
};

}  // namespace covey
