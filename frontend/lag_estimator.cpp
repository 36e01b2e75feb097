// SPDX-License-Identifier: Apache-2.0
#include "frontend/lag_estimator.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace covey {

LagEstimator::LagEstimator(const PixelLagConfig& config)
    : config_(config),
      time_constant_s_(config.time_constant_s),
      variance_(config.sigma_s * config.sigma_s) {}

// A wave of k rad/px whose lag is taken out by s too little is seen s v (k v tau)^2 / (1 + (k v
// tau)^2) too early. Patches are found by waves of about 0.9 rad/px, in images of half the size by
// those of 0.6.
Eigen::Vector2d LagEstimator::scales_apart(const Eigen::Vector2d& flow) const {
  constexpr double kFine = 0.9, kCoarse = 0.6;
  constexpr double kLeast_s = 0.004;  // pixels that hardly lag would tell nothing any more
  const double path2 = std::pow(std::max(kLeast_s, time_constant_s_), 2) * flow.squaredNorm();
  const auto early = [path2](double k) { return k * k * path2 / (1 + k * k * path2); };
  return (early(kFine) - early(kCoarse)) * flow;
}

const LagEstimator::Cut* LagEstimator::cut_of(std::uint64_t patch_id) const {
  const auto found =
      std::lower_bound(cuts_.begin(), cuts_.end(), patch_id,
                       [](const Cut& cut, std::uint64_t id) { return cut.patch_id < id; });
  return found != cuts_.end() && found->patch_id == patch_id ? &*found : nullptr;
}

void LagEstimator::learn(TimeNs stamp_ns, const std::vector<TrackPlace>& tracks,
                         const PixelLag& motion) {
  constexpr double kMost_px = 1;  // a larger shift is no lag
  constexpr double kLongest_s = 0.05;
  if (config_.sigma_s == 0) return;
  double information = 0, sum = 0;
  std::vector<Cut> cuts;
  cuts.reserve(tracks.size());
  for (const TrackPlace& track : tracks) {
    const Eigen::Vector2d apart = scales_apart(motion.flow(track.place.pixel));
    const Cut* cut = cut_of(track.patch_id);
    cuts.push_back(cut ? *cut : Cut{track.patch_id, apart, time_constant_s_});
    if (!cut || !track.coarse_shift || track.coarse_shift->norm() > kMost_px) continue;
    const Eigen::Vector2d then = track.place.affine * cut->apart;
    const Eigen::Vector2d slope = apart - then;
    sum += slope.dot(time_constant_s_ * apart - cut->taken_out_s * then - *track.coarse_shift);
    information += slope.squaredNorm();
  }
  std::sort(cuts.begin(), cuts.end(),
            [](const Cut& a, const Cut& b) { return a.patch_id < b.patch_id; });
  cuts_ = std::move(cuts);

  const double elapsed_s = learnt_ns_ == 0 ? 0 : seconds_between(learnt_ns_, stamp_ns);
  learnt_ns_ = stamp_ns;
  variance_ += config_.wander * config_.wander * elapsed_s;
  const double noise = config_.shift_sigma_px * config_.shift_sigma_px;
  const double known = noise / (variance_ * information + noise);
  const double step = variance_ / noise * known * (sum - information * time_constant_s_);
  time_constant_s_ = std::clamp(time_constant_s_ + step, 0.0, kLongest_s);
  variance_ *= known;
}

}  // namespace covey
