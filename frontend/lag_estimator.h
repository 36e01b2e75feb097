// SPDX-License-Identifier: Apache-2.0
//
// How much pixels lag (pixel_lag.h), from the images themselves. Where too little of the lag is
// taken out fine texture is seen too early, and coarse texture less so: between a patch as it was
// cut and as it is seen at another speed, the two move apart. Where too much is taken out they move
// apart the other way. One unknown for all tracks of a flight: a Kalman filter of one number.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "frontend/pixel_lag.h"
#include "frontend/tracker.h"

namespace covey {

struct PixelLagConfig {
  double time_constant_s = 0.008;  // s, of a FLIR Boson; 0: pixels do not lag
  double sigma_s = 0.004;          // s, of that; 0: it is known
  // Of PatchFit::coarse_shift: the tenth of a pixel that one is wrong, times what comes of errors
  // that last and are shared.
  double shift_sigma_px = 3;
  double wander = 2e-4;  // s/sqrt(s), of the estimate: its model is rough
};

class LagEstimator {
 public:
  explicit LagEstimator(const PixelLagConfig& config);

  // Where tracks were found in an image that moved like that and out of which `time_constant_s()`
  // was taken.
  void learn(TimeNs stamp_ns, const std::vector<TrackPlace>& tracks, const PixelLag& motion);

  [[nodiscard]] double time_constant_s() const { return time_constant_s_; }

 private:
  // What a patch looked like when it was cut.
  struct Cut {
    std::uint64_t patch_id = 0;
    Eigen::Vector2d apart = Eigen::Vector2d::Zero();  // fine from coarse texture, px for each s
    double taken_out_s = 0;                           // the time constant of then
  };

  [[nodiscard]] Eigen::Vector2d scales_apart(const Eigen::Vector2d& flow) const;
  [[nodiscard]] const Cut* cut_of(std::uint64_t patch_id) const;

  PixelLagConfig config_;
  double time_constant_s_;
  double variance_;  // s2, of it
  TimeNs learnt_ns_ = 0;
  std::vector<Cut> cuts_;  // of the tracks, by patch
};

}  // namespace covey
