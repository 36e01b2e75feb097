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
// What moves how is known before the image is tracked: from the gyro, and from the tracks so far.
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

#include "frontend/camera.h"
#include "frontend/tracker.h"

namespace covey {

class PixelLag {
 public:
  explicit PixelLag(const CameraIntrinsics& camera);

  // Of the image that is to be looked at. `rate_cam`: of the camera, rad/s. `tracks`: where they
  // are expected in it.
  void set_motion(const Eigen::Vector3d& rate_cam, const std::vector<TrackPlace>& tracks);

  // Of what this pixel sees, px/s.
  [[nodiscard]] Eigen::Vector2d flow(const Eigen::Vector2d& pixel) const;

  // `grey`: CV_8UC1, the camera's size, stamped one time constant before its readout. Not
  // sharpened within two pixels of its edge.
  [[nodiscard]] cv::Mat taken_out(const cv::Mat& grey, double time_constant_s);

 private:
  struct Node {
    Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
    // Motion of the pixel, px/s for each rad/s of the camera.
    Eigen::Matrix<double, 2, 3> flow_rate = Eigen::Matrix<double, 2, 3>::Zero();
  };
  struct Stretch;

  void set_paths(double time_constant_s);
  template <typename Use>
  void for_each_stretch(int y, Use use) const;
  void sharpen(const cv::Mat& grey);
  void extend_edges();

  int columns_, rows_;  // of nodes
  std::vector<Node> nodes_;
  std::vector<Eigen::Vector2f> flows_;  // at the nodes, px/s
  std::vector<Eigen::Vector2f> paths_;  // at the nodes, px, during one time constant
  cv::Mat readout_;  // CV_16SC1, without lag, parts of a grey level; with a margin
};

}  // namespace covey
