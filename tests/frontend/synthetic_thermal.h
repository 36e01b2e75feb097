// SPDX-License-Identifier: Apache-2.0
// A camera that slides over a warm plane, with everything a thermal camera does to its images
// known.
#pragma once

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/tracker.h"

namespace covey {

class SyntheticThermal {
 public:
  static constexpr int kWidth = 320, kHeight = 256;  // px
  static constexpr double kPeriod_s = 1.0 / 30;

  double field_sigma = 8;       // grey levels of the first image
  double noise = 0.5;           // grey levels
  double contrast = 1;          // of the scene alone
  double gain = 1, offset = 0;  // of the current image: what takes it to the first one's levels
  bool saturated_half = false;
  int white16 = 65535;  // largest value of a sensor of 16 bits or fewer
  std::vector<cv::Point> hot_pixels;
  int hot16 = 65535;  // their value in an image of 16 bits
  cv::Mat stripes;    // CV_32FC1, grey levels of the first image; empty: none

  explicit SyntheticThermal(unsigned seed) : random_(seed) {
    plane_.create(kPlane, kPlane, CV_32FC1);
    cv::Mat cells(kPlane / 12, kPlane / 12, CV_32FC1);
    fill(cells);
    cv::resize(cells, plane_, plane_.size(), 0, 0, cv::INTER_CUBIC);
    plane_ = kMean + 30 * plane_;
    cv::Mat slow(3, 4, CV_32FC1);
    fill(slow);
    cv::resize(slow, field_, {kWidth, kHeight}, 0, 0, cv::INTER_CUBIC);
    field_ -= cv::mean(field_)[0];
    while (landmarks_.size() < kTracks) add_track();
  }

  // Small hot things all over the plane, on so many of its pixels.
  void sprinkle(double share) {
    std::uniform_int_distribution<int> anywhere(0, kPlane - 1);
    const int things = static_cast<int>(share * kPlane * kPlane);
    for (int i = 0; i < things; ++i) {
      plane_.at<float>(anywhere(random_), anywhere(random_)) += 100;
    }
  }

  // Moves on: the camera circles and sways, tracks leave and new ones come.
  void advance() {
    time_s_ += kPeriod_s;
    const double turn = 0.35 * time_s_;
    centre_ = Eigen::Vector2d(kPlane / 2.0 + 300 * std::sin(turn),
                              kPlane / 2.0 + 250 * std::cos(1.3 * turn));
    yaw_ = 0.5 * std::sin(1.7 * time_s_);
    std::vector<Landmark> kept;
    for (const Landmark& landmark : landmarks_) {
      if (visible(landmark)) kept.push_back(landmark);
    }
    landmarks_ = std::move(kept);
    while (landmarks_.size() < kTracks) add_track();
  }

  [[nodiscard]] std::vector<TrackPlace> tracks() const {
    std::vector<TrackPlace> places;
    for (const Landmark& landmark : landmarks_) {
      PatchPlace place;
      place.pixel = in_image(landmark.plane);
      place.affine = Eigen::Rotation2Dd(-yaw_).toRotationMatrix();
      places.push_back({landmark.id, place});
    }
    return places;
  }
  [[nodiscard]] TimeNs stamp_ns() const { return nanoseconds(100 + time_s_); }
  [[nodiscard]] cv::Mat field() const { return field_sigma * field_; }
  [[nodiscard]] const cv::Mat& last_image() const { return image_; }

  // Grey levels, CV_8UC1, or 16 bits: 100 counts for each of them, 20000 for none, or
  // less for a sensor of fewer bits.
  cv::Mat expose(bool wide = false) {
    cv::Mat scene;
    const Eigen::Matrix2d R = Eigen::Rotation2Dd(yaw_).toRotationMatrix();
    const Eigen::Vector2d corner = centre_ - R * middle();
    const cv::Matx23d to_plane(R(0, 0), R(0, 1), corner.x(), R(1, 0), R(1, 1), corner.y());
    cv::warpAffine(plane_, scene, to_plane, {kWidth, kHeight},
                   cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REFLECT);
    scene = contrast * scene + (1 - contrast) * kMean;
    cv::Mat grain(scene.size(), CV_32FC1);
    fill(grain);
    scene += field() + noise * grain;
    if (!stripes.empty()) scene += stripes;
    if (saturated_half) scene.colRange(0, kWidth / 2) = 5000;
    if (wide) {
      const double counts = 100.0 * white16 / 65535;
      scene.convertTo(image_, CV_16UC1, counts / gain, counts * (200 - offset / gain));
      image_ = cv::min(image_, white16);
    } else {
      scene.convertTo(image_, CV_8UC1, 1 / gain, -offset / gain);
    }
    for (const cv::Point& p : hot_pixels) {
      if (wide) image_.at<std::uint16_t>(p) = static_cast<std::uint16_t>(std::min(hot16, white16));
      if (!wide) image_.at<std::uint8_t>(p) = 255;
    }
    return image_;
  }

 private:
  static constexpr int kPlane = 1400;   // px
  static constexpr double kMean = 128;  // grey level
  static constexpr std::size_t kTracks = 200;

  void fill(cv::Mat& values) {
    std::normal_distribution<float> gaussian;
    for (int y = 0; y < values.rows; ++y) {
      for (int x = 0; x < values.cols; ++x) values.at<float>(y, x) = gaussian(random_);
    }
  }
  struct Landmark {
    std::uint64_t id = 0;
    Eigen::Vector2d plane;  // px of the plane
  };
  static Eigen::Vector2d middle() { return {(kWidth - 1) / 2.0, (kHeight - 1) / 2.0}; }
  [[nodiscard]] Eigen::Vector2d in_image(const Eigen::Vector2d& plane) const {
    return Eigen::Rotation2Dd(-yaw_) * (plane - centre_) + middle();
  }
  [[nodiscard]] bool visible(const Landmark& landmark) const {
    const Eigen::Vector2d p = in_image(landmark.plane);
    return p.minCoeff() > 6 && p.x() < kWidth - 7 && p.y() < kHeight - 7;
  }
  void add_track() {
    std::uniform_real_distribution<double> share(0.03, 0.97);
    const Eigen::Vector2d pixel(kWidth * share(random_), kHeight * share(random_));
    landmarks_.push_back({next_id_++, centre_ + Eigen::Rotation2Dd(yaw_) * (pixel - middle())});
  }

  std::mt19937 random_;
  cv::Mat plane_, field_;
  Eigen::Vector2d centre_{kPlane / 2.0, kPlane / 2.0 + 250};
  double yaw_ = 0;  // rad
  std::vector<Landmark> landmarks_;
  std::uint64_t next_id_ = 1;
  double time_s_ = 0;
  cv::Mat image_;
};

}  // namespace covey
