// SPDX-License-Identifier: Apache-2.0
#include "estimator/filter_health.h"

#include "estimator/imu_transition.h"

namespace covey {
namespace {

constexpr double kDegradedAfter_s = 0.5;   // without a feature that fits
constexpr std::size_t kEnoughTracks = 20;  // to see with

// Of a velocity of which nothing is known, along each axis.
constexpr double kAnyVelocitySigma = 10;  // m/s

bool is_possible(const Eigen::Vector3d& velocity, const EstimatorConfig& config) {
  return velocity.norm() < config.max_velocity;
}

bool is_possible(const State& state, const EstimatorConfig& config) {
  const ImuState& imu = state.imu();
  return imu.pose.p_world_imu.allFinite() && imu.pose.q_world_imu.coeffs().allFinite() &&
         is_possible(imu.v_world_imu, config) && (state.covariance().diagonal().array() >= 0).all();
}

}  // namespace

void FilterHealth::begin(const State& state) {
  status_ = FilterStatus::kTracking;
  contradicted_since_ns_.reset();
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
  const TimeNs now_ns = state.imu().stamp_ns;
  if (failed || gated > used) {
    if (!contradicted_since_ns_) contradicted_since_ns_ = now_ns;
  } else {
    contradicted_since_ns_.reset();
  }
  const double blind_s = seconds_between(healthy_ns_, now_ns);
  if (possible && blind_s < kDegradedAfter_s) return Remedy::kNone;
  status_ = FilterStatus::kDegraded;
  const bool contradicted = contradicted_since_ns_ &&
                            seconds_between(*contradicted_since_ns_, now_ns) > config.lost_after_s;
  if (!possible || contradicted) return Remedy::kRestart;
  const bool nothing_fits = used == 0 && gated == 0 && !failed;
  return seeing && nothing_fits && tracks >= kEnoughTracks && blind_s > config.lost_after_s
             ? Remedy::kLookAgain
             : Remedy::kNone;
}

void FilterHealth::pass(TimeNs stamp_ns, const ImuInterval& interval,
                        const EstimatorConfig& config) {
  carry(interval, config);
  miss(stamp_ns);
}

CoreState FilterHealth::fallback(const EstimatorConfig& config) const {
  CoreState core = healthy_;
  if (is_possible(core.imu.v_world_imu, config)) return core;
  constexpr int kVelocity = State::kVelocity;
  core.imu.v_world_imu.setZero();
  core.covariance.middleRows<3>(kVelocity).setZero();
  core.covariance.middleCols<3>(kVelocity).setZero();
  core.covariance.diagonal().segment<3>(kVelocity).setConstant(kAnyVelocitySigma *
                                                               kAnyVelocitySigma);
  return core;
}

void FilterHealth::miss(TimeNs stamp_ns) {
  contradicted_since_ns_.reset();
  if (seconds_between(healthy_ns_, stamp_ns) >= kDegradedAfter_s) status_ = FilterStatus::kDegraded;
}

void FilterHealth::carry(const ImuInterval& interval, const EstimatorConfig& config) {
  healthy_ = dead_reckoned(healthy_, interval, config);
}

}  // namespace covey
