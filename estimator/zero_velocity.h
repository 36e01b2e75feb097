// SPDX-License-Identifier: Apache-2.0
//
// Standing still, detected and used (ZUPT). Without it a mono filter on the ground drifts: there is
// no baseline, and the accelerometer's bias integrates.
#pragma once

#include <deque>
#include <optional>
#include <vector>

#include "estimator/ekf_update.h"
#include "estimator/keyframe_policy.h"
#include "estimator/state.h"

namespace covey {

// True when the inertial readings do not change over the window: mean rate and mean specific force
// of its halves agree, and the rate is small. Works under vibration, which averages out.
[[nodiscard]] bool inertially_still(const std::vector<ImuSample>& window,
                                    const EstimatorConfig& config,
                                    const Eigen::Vector3d& gyro_bias);

// Remembers recent images and tells whether the tracks stood still over the window.
class StillnessDetector {
 public:
  void add_image(TimeNs stamp_ns, const TrackList& tracks, const EstimatorConfig& config);
  // Nothing unless the tracks stood still: median motion of shared tracks over a whole window of
  // images, rotation taken out, below `still_parallax`; and since each image kept of the last
  // seconds, as it was seen, below `still_drift`: above level ground flying sideways looks like
  // turning, but who hovers comes back. If they did, how fast they have moved all the same over
  // these seconds, 1/s on the normalised plane: the drone may fly as fast as that, times the depth.
  [[nodiscard]] std::optional<double> speed_if_still(const EstimatorConfig& config) const;
  void clear() { *this = {}; }

 private:
  struct Image {
    TimeNs stamp_ns;
    TrackList tracks;
  };
  // Largest, since any of the images kept of the last seconds.
  [[nodiscard]] double motion_seen() const;

  std::deque<Image> window_, past_;
};

// Pseudo-measurements: velocity is zero, the gyro shows its bias, the accelerometer gravity and
// bias. Whitened, r = H dx + n.
struct StillRows {
  Eigen::Matrix<double, 9, State::kImuSize> H = Eigen::Matrix<double, 9, State::kImuSize>::Zero();
  Eigen::Matrix<double, 9, 1> r = Eigen::Matrix<double, 9, 1>::Zero();
};
// `velocity_sigma`: m/s, how surely it is zero.
[[nodiscard]] StillRows still_rows(const ImuState& imu, const std::vector<ImuSample>& interval,
                                   double velocity_sigma, const EstimatorConfig& config);

// What is known of a drone that seems to stand.
struct Stillness {
  // It has not flown yet. Otherwise it may glide: slowly, and with a little acceleration.
  bool stands = false;
  double unseen_speed = 0;  // m/s, with which it might fly without that being seen
};

// Of a drone that may glide, what is not seen is the same from image to image, and is not to be
// counted anew in each: what the state knows better is not said. False when they contradict the
// state (chi-square): nothing is changed then.
[[nodiscard]] bool update_zero_velocity(State& state, EkfUpdate& update,
                                        const std::vector<ImuSample>& interval,
                                        const Stillness& still, const EstimatorConfig& config);

}  // namespace covey
