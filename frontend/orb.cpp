// SPDX-License-Identifier: Apache-2.0
#include "frontend/orb.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <opencv2/features2d.hpp>

namespace covey {
namespace {

constexpr int kPatchSide = 31;  // px, of ORB's moments and its test pattern
constexpr int kRadius = kPatchSide / 2;
// The pattern turned by 45 degrees, and the blur's kernel, reach this far: px.
constexpr int kBorder = 23;

std::array<int, kRadius + 1> half_widths() {
  std::array<int, kRadius + 1> widths{};
  for (int y = 0; y <= kRadius; ++y) {
    widths[static_cast<std::size_t>(y)] =
        static_cast<int>(std::sqrt(static_cast<double>(kRadius * kRadius - y * y)));
  }
  return widths;
}

float to_degrees(double y, double x) {
  const double degrees = std::atan2(y, x) * 180 / M_PI;
  return static_cast<float>(degrees < 0 ? degrees + 360 : degrees);
}

// Direction from the centre to the intensity centroid of a disc, degrees (Rosin 1999).
float centroid_angle(const cv::Mat& image, const cv::Point& centre) {
  static const std::array<int, kRadius + 1> widths = half_widths();
  int m10 = 0, m01 = 0;
  for (int y = -kRadius; y <= kRadius; ++y) {
    const std::uint8_t* row = image.ptr<std::uint8_t>(centre.y + y) + centre.x;
    const int width = widths[static_cast<std::size_t>(std::abs(y))];
    int sum = 0, moment = 0;
    for (int x = -width; x <= width; ++x) {
      sum += row[x];
      moment += x * row[x];
    }
    m10 += moment;
    m01 += y * sum;
  }
  return to_degrees(m01, m10);
}

}  // namespace

std::vector<std::optional<BinaryDescriptor>> describe_places(
    const cv::Mat& image, const std::vector<Eigen::Vector2d>& pixels,
    const std::vector<float>& directions_deg) {
  assert(directions_deg.empty() || directions_deg.size() == pixels.size());
  const cv::Rect allowed(kBorder, kBorder, image.cols - 2 * kBorder, image.rows - 2 * kBorder);
  std::vector<cv::KeyPoint> keypoints;
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    const cv::Point place(static_cast<int>(std::lround(pixels[i].x())),
                          static_cast<int>(std::lround(pixels[i].y())));
    if (!allowed.contains(place)) continue;
    const float angle = directions_deg.empty() ? centroid_angle(image, place) : directions_deg[i];
    keypoints.emplace_back(cv::Point2f(place), static_cast<float>(kPatchSide), angle, 0.0f, 0,
                           static_cast<int>(i));
  }
  std::vector<std::optional<BinaryDescriptor>> descriptors(pixels.size());
  if (keypoints.empty()) return descriptors;
  const cv::Ptr<cv::ORB> orb =
      cv::ORB::create(static_cast<int>(keypoints.size()), 1.2f, 1, kBorder);
  cv::Mat rows;
  orb->compute(image, keypoints, rows);
  for (std::size_t i = 0; i < keypoints.size(); ++i) {
    BinaryDescriptor descriptor{};
    std::copy_n(rows.ptr<std::uint8_t>(static_cast<int>(i)), descriptor.size(), descriptor.begin());
    descriptors[static_cast<std::size_t>(keypoints[i].class_id)] = descriptor;
  }
  return descriptors;
}

std::vector<float> world_directions_deg(const CameraIntrinsics& camera,
                                        const std::vector<Eigen::Vector2d>& bearings,
                                        const Eigen::Matrix3d& R_world_cam) {
  constexpr double kSteep = 0.5;  // sine of the optical axis' elevation
  const bool steep = std::abs(R_world_cam(2, 2)) > kSteep;
  const Eigen::Vector3d direction_world = steep ? Eigen::Vector3d(Eigen::Vector3d::UnitX())
                                                : Eigen::Vector3d(-Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d direction_cam = R_world_cam.transpose() * direction_world;
  std::vector<float> directions_deg;
  for (const Eigen::Vector2d& bearing : bearings) {
    Eigen::Matrix2d J_pixel_bearing;
    (void)project(camera, bearing, &J_pixel_bearing);
    // d(bearing) of a point that moves along the direction.
    const Eigen::Vector2d moved = direction_cam.head<2>() - bearing * direction_cam.z();
    const Eigen::Vector2d in_image = J_pixel_bearing * moved;
    directions_deg.push_back(to_degrees(in_image.y(), in_image.x()));
  }
  return directions_deg;
}

}  // namespace covey
