// SPDX-License-Identifier: Apache-2.0
//
// The pixels of a microbolometer follow what they see as a thermometer does: tau dI/dt = S - I.
// Where the image moves they smear it along its way and show it late, fine texture less late than
// coarse: a wave with wave vector k that moves at v lags by atan(k.v tau) of phase. Stamps account
// for the mean delay, tau; what is left moves a corner by up to a pixel when it is seen at another
// speed.
//
// An image that moves at v changes by dI/dt = -v.grad I, so one image is enough to know what its
// pixels would have shown without lag, S = I - tau v.grad I, at its readout. That image is moved
// back by tau v, to what the stamp stands for: so an error of v moves coarse texture by nothing.
//
// The rows of a rolling shutter look one after the other. What a row shows is moved back by the
// flow during the time by which it looks later than the middle one, for which the stamp stands.
//
// What moves how is known before the image is tracked: from the gyro, and from the tracks so far.
// Between tracks it is guessed; once a track is found its own motion says how much too far the rows
// have taken it.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "frontend/camera.h"
#include "frontend/tracker.h"

namespace covey {

// How a camera or an IMU turns at a moment, in its own axes.
struct Turn {
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();          // rad/s
  Eigen::Vector3d acceleration = Eigen::Vector3d::Zero();  // rad/s2
};

class PixelLag {
 public:
  // `line_delay_s`: s, by which each row looks later than the one above it; 0: all look at once.
  explicit PixelLag(const CameraIntrinsics& camera, double line_delay_s = 0);

  // Of the image that is to be looked at. `tracks`: where they are expected in it.
  void set_motion(const Turn& turn, const std::vector<TrackPlace>& tracks);

  // Of what this pixel sees, px/s.
  [[nodiscard]] Eigen::Vector2d flow(const Eigen::Vector2d& pixel) const;

  // `grey`: CV_8UC1, the camera's size, stamped one time constant before the readout of its middle
  // row. Not sharpened within two pixels of its edge.
  [[nodiscard]] cv::Mat taken_out(const cv::Mat& grey, double time_constant_s);

  // How far from where it belongs at the stamp a track was found, px, that moves by
  // TrackPlace::velocity and not as what is around it.
  [[nodiscard]] Eigen::Vector2d taken_too_far(const TrackPlace& track) const;

 private:
  struct Node {
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    // Motion of the pixel, px/s for each rad/s of the camera.
    Eigen::Matrix<double, 2, 3> flow_rate = Eigen::Matrix<double, 2, 3>::Zero();
  };
  struct Stretch;
  using AtNodes = std::vector<Eigen::Vector2f>;

  // By how much a row looks later than the middle one.
  [[nodiscard]] double later_s(double y) const { return line_delay_s_ * (y - middle_row_); }
  [[nodiscard]] Eigen::Vector2d between_nodes(const AtNodes& values,
                                              const Eigen::Vector2d& pixel) const;
  void set_paths(double time_constant_s);
  template <typename Use>
  void for_each_stretch(const AtNodes& paths, int y, Use use) const;
  void sharpen(const cv::Mat& grey);
  void extend_edges();

  int columns_, rows_;  // of nodes
  std::vector<Node> nodes_;
  double line_delay_s_, middle_row_;
  AtNodes velocities_;  // px/s, of the tracks around: what rotation does not explain
  AtNodes flows_;       // px/s
  AtNodes smears_;      // px, during one time constant
  AtNodes moves_;       // px, from the stamp until the pixel is read
  cv::Mat readout_;     // CV_16SC1, without lag, parts of a grey level; with a margin
};

}  // namespace covey
