// SPDX-License-Identifier: Apache-2.0
#include "estimator/peer_claims.h"

#include <algorithm>
#include <cmath>
#include <iterator>

namespace covey {
namespace {

constexpr std::size_t kMaxHistory = 10000;  // own keyframes

struct FoundVariances {
  double position = 0, angle = 0;  // m2 and rad2, sums over the three axes
};

FoundVariances variances_of(const RelativePose& measurement) {
  return {measurement.covariance.topLeftCorner<3, 3>().trace(),
          measurement.covariance.bottomRightCorner<3, 3>().trace()};
}

void enlarge(RelativePose& measurement, double factor) {
  measurement.covariance *= factor;
  if (!measurement.depth_ratio) return;
  measurement.depth_ratio->variance *= factor;
  measurement.depth_ratio->covariance_with_pose *= factor;
}

}  // namespace

void PeerClaims::add_own(const KeyframePose& pose) {
  if (own_history_.size() >= kMaxHistory) own_history_.pop_front();
  own_history_.push_back(
      {pose.stamp_ns, pose.covariance.topLeftCorner<3, 3>().trace(), pose.covariance(5, 5)});
}

// At least a share of what the own odometry had drifted by then: who claims less is not believed.
Matrix6d PeerClaims::believable(const KeyframePose& peer) const {
  const auto after = std::upper_bound(
      own_history_.begin(), own_history_.end(), peer.stamp_ns,
      [](TimeNs stamp_ns, const OwnDrift& own) { return stamp_ns < own.stamp_ns; });
  if (after == own_history_.begin()) return peer.covariance;
  const OwnDrift& own = *std::prev(after);
  const double position = peer.covariance.topLeftCorner<3, 3>().trace();
  const double yaw = peer.covariance(5, 5);
  const double factor = config_.least_claim * std::max(own.position / position, own.yaw / yaw);
  return std::max(1.0, factor) * peer.covariance;
}

RelativePose PeerClaims::believable(RelativePose measurement) const {
  if (!measurement.found_by_other) return measurement;
  const double m = config_.found_position_sigma_m, rad = config_.found_angle_sigma;
  measurement.covariance.diagonal().head<3>().array() += m * m;
  measurement.covariance.diagonal().tail<3>().array() += rad * rad;
  if (usual_found_.count == 0) return measurement;
  const FoundVariances claimed = variances_of(measurement);
  const double factor =
      config_.least_claim * std::max(std::exp(usual_found_.log_position) / claimed.position,
                                     std::exp(usual_found_.log_angle) / claimed.angle);
  enlarge(measurement, std::max(1.0, factor));
  return measurement;
}

void PeerClaims::learn_usual(const RelativePose& used) {
  constexpr int kMemory = 100;
  if (used.found_by_other) return;
  usual_found_.count = std::min(usual_found_.count + 1, kMemory);
  const FoundVariances variances = variances_of(used);
  const double share = 1.0 / usual_found_.count;
  usual_found_.log_position += share * (std::log(variances.position) - usual_found_.log_position);
  usual_found_.log_angle += share * (std::log(variances.angle) - usual_found_.log_angle);
}

}  // namespace covey
