// SPDX-License-Identifier: Apache-2.0
#include "estimator/filter_health.h"

#include "estimator/imu_transition.h"

namespace covey {
namespace {

constexpr double kDegradedAfter_s = 0.5;   // without a feature that fits
constexpr std::size_t kEnoughTracks = 20;  // to see with

bool is_possible(const State& state, const EstimatorConfig& config) {
  const ImuState& imu = state.imu();
  return imu.pose.p_world_imu.allFinite() && imu.pose.q_world_imu.coeffs().allFinite() &&
         imu.v_world_imu.norm() < config.max_velocity &&
         (state.covariance().diagonal().array() >= 0).all();
}

}  // namespace

void FilterHealth::begin(const State& state) {
  status_ = FilterStatus::kTracking;
  healthy_ns_ = state.imu().stamp_ns;
  healthy_ = state.core();
}

Remedy FilterHealth::watch(const State& state, const UpdateReport& report, std::size_t tracks,
                           bool seeing, const std::optional<ImuInterval>& interval,
                           const EstimatorConfig& config) {
  const int used = report.slam_used + report.msckf_used;
  const int gated = report.slam_gated + report.msckf_gated;
  const bool possible = is_possible(state, config);
  const bool failed = report.failed_updates > 0;
  if (possible && !failed && (report.zero_velocity || (used > 0 && used >= gated))) {
    begin(state);
    return Remedy::kNone;
  }
  if (interval) carry(*interval, config);
  const double blind_s = seconds_between(healthy_ns_, state.imu().stamp_ns);
  if (possible && blind_s < kDegradedAfter_s) return Remedy::kNone;
  status_ = FilterStatus::kDegraded;
  const bool for_long = blind_s > config.lost_after_s;
  if (!possible || ((failed || gated > used) && for_long)) return Remedy::kRestart;
  return seeing && tracks >= kEnoughTracks && for_long ? Remedy::kLookAgain : Remedy::kNone;
}

void FilterHealth::pass(TimeNs stamp_ns, const ImuInterval& interval,
                        const EstimatorConfig& config) {
  carry(interval, config);
  miss(stamp_ns);
}

void FilterHealth::miss(TimeNs stamp_ns) {
  if (seconds_between(healthy_ns_, stamp_ns) >= kDegradedAfter_s) status_ = FilterStatus::kDegraded;
}

void FilterHealth::carry(const ImuInterval& interval, const EstimatorConfig& config) {
  healthy_ = dead_reckoned(healthy_, interval, config);
}

}  // namespace covey
