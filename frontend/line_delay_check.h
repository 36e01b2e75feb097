// SPDX-License-Identifier: Apache-2.0
//
// Whether a camera reads its image row by row without its sensor.yaml saying so (`line_delay`).
// A corner that is read d s after the stamp is seen d times its flow from where it belongs. How
// far that changes from one image to another shows in what the filter's poses and depths do not
// explain; d is a line's delay times the rows from the middle, so least squares over all tracks
// tell the delay. The filter takes a part of it for motion: half of it is found, or two thirds.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "frontend/tracker.h"

namespace covey {

class LineDelayCheck {
 public:
  // `line_delay_s`: what is known of it, and taken out of the tracks.
  explicit LineDelayCheck(const CameraIntrinsics& camera, double line_delay_s = 0);

  // Whether the next image is looked at: one of five, for depths take time.
  [[nodiscard]] bool is_due() const;
  // The tracks of an image, how far away they lie in it (needed if it is due), and the camera's
  // pose there.
  void add(const TrackedFrame& frame, const Eigen::Isometry3d& T_world_cam,
           const std::vector<TrackDepth>& depths);

  // s, of a line, since the images have shown plainly that it is not what it is said to be: about
  // how long it is, rather longer. Nothing otherwise.
  [[nodiscard]] std::optional<double> found_s() const { return found_s_; }

 private:
  struct Seen {
    std::uint64_t track_id = 0;
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    std::optional<Eigen::Vector2d> late;  // px by which it is displaced for each s of a line
  };
  struct View {
    TimeNs stamp_ns = 0;
    Eigen::Isometry3d T_world_cam = Eigen::Isometry3d::Identity();
    std::vector<Seen> seen;  // by track
  };

  [[nodiscard]] View view_of(const TrackedFrame& frame, const Eigen::Isometry3d& T_world_cam) const;
  [[nodiscard]] bool is_plain(double delay_s) const;
  void compare(const View& then, const View& now, const std::vector<TrackDepth>& depths);

  CameraIntrinsics camera_;
  double line_delay_s_;
  std::deque<View> views_;  // the newest last
  // Sums over tracks, of which older ones count less.
  double late_late_ = 0, late_off_ = 0, off_off_ = 0, weight_ = 0;
  std::int64_t images_ = 0, compared_ = 0;
  std::optional<double> found_s_;
};

}  // namespace covey
