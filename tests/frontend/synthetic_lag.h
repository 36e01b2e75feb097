// SPDX-License-Identifier: Apache-2.0
//
// A texture that moves, as pixels that lag exponentially show it.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "frontend/camera.h"
#include "frontend/tracker.h"

namespace covey {

constexpr double kLag_s = 0.008;
constexpr int kWidth = 320, kHeight = 240;

inline CameraIntrinsics lagging_camera() {
  return {kWidth,
          kHeight,
          180,
          185,
          158,
          121,
          DistortionModel::kRadialTangential,
          {-0.2, 0.05, 0.001, -0.002}};
}

// Fine and coarse texture, larger than the image.
inline cv::Mat scene() {
  cv::Mat white(2 * kHeight, 2 * kWidth, CV_32FC1), fine, coarse;
  cv::RNG random(7);
  random.fill(white, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(white, fine, {}, 1.3);
  cv::GaussianBlur(white, coarse, {}, 5);
  return 128 + 110 * fine + 430 * coarse;
}

// What pixels that lag show of a scene that moves at `velocity`, px/s; at the moment of the stamp,
// one time constant before they are read out, it lies where it lies at rest.
inline cv::Mat seen(const cv::Mat& scene, const Eigen::Vector2d& velocity,
                    double time_constant_s = kLag_s) {
  constexpr int kInstants = 50;
  constexpr double kReach = 7;  // time constants
  cv::Mat sum = cv::Mat::zeros(kHeight, kWidth, CV_32FC1);
  double total = 0;
  for (int i = 0; i < kInstants; ++i) {
    const double ago = (i + 0.5) / kInstants * kReach;
    const Eigen::Vector2d from =
        Eigen::Vector2d(kWidth / 2, kHeight / 2) + time_constant_s * (ago - 1) * velocity;
    const cv::Matx23d to_scene(1, 0, from.x(), 0, 1, from.y());
    cv::Mat instant;
    cv::warpAffine(scene, instant, to_scene, sum.size(), cv::INTER_CUBIC | cv::WARP_INVERSE_MAP);
    sum += std::exp(-ago) * instant;
    total += std::exp(-ago);
  }
  cv::Mat grey;
  sum.convertTo(grey, CV_8UC1, 1 / total);
  return grey;
}

// One track that all of the image moves with.
inline std::vector<TrackPlace> moving(const Eigen::Vector2d& velocity) {
  TrackPlace track;
  track.place.pixel = {100, 100};
  track.velocity = velocity;
  return {track};
}

}  // namespace covey
