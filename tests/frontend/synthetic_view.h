// SPDX-License-Identifier: Apache-2.0
//
// A camera before a textured, slanted plane: images with known motion and known places of every
// point.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "estimator/measurements.h"
#include "estimator/so3.h"
#include "frontend/camera.h"

namespace covey::testing_view {

inline CameraIntrinsics small_camera() {
  CameraIntrinsics camera;
  camera.width = 320;
  camera.height = 240;
  camera.fx = 200;
  camera.fy = 199;
  camera.cx = 158;
  camera.cy = 121;
  camera.distortion = {-0.2, 0.04, 0.0002, 0.00001};
  return camera;
}

// Corners of all sizes: random shades at several scales, edges softened like a lens does.
inline cv::Mat random_texture(int side, int seed) {
  cv::RNG random(static_cast<std::uint64_t>(seed));
  cv::Mat texture(side, side, CV_32F, cv::Scalar(120));
  for (const int block : {4, 8, 16, 32}) {
    cv::Mat coarse(side / block, side / block, CV_32F), fine;
    random.fill(coarse, cv::RNG::NORMAL, 0.0, 22.0);
    cv::resize(coarse, fine, texture.size(), 0, 0, cv::INTER_NEAREST);
    texture += fine;
  }
  cv::GaussianBlur(texture, texture, {0, 0}, 1.2);
  return cv::max(5.0, cv::min(250.0, texture));
}

struct CameraPose {
  Eigen::Matrix3d R_world_cam = Eigen::Matrix3d::Identity();
  Eigen::Vector3d p_world_cam = Eigen::Vector3d::Zero();
};

inline Eigen::Matrix3d rotation_between(const CameraPose& from, const CameraPose& to) {
  return to.R_world_cam.transpose() * from.R_world_cam;
}

// The world is the first camera's frame: z away from the viewer; the plane passes (0, 0, 4) m and
// leans.
class SlantedPlane {
 public:
  explicit SlantedPlane(const CameraIntrinsics& camera, int seed = 7)
      : camera_(camera), texture_(random_texture(kTextureSide, seed)) {
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        bearings_.push_back(unproject(camera, {x, y}).value_or(Eigen::Vector2d::Zero()));
      }
    }
  }

  [[nodiscard]] Eigen::Vector3d point(const CameraPose& pose,
                                      const Eigen::Vector2d& bearing) const {
    const Eigen::Vector3d ray = pose.R_world_cam * bearing.homogeneous();
    return pose.p_world_cam + ray * (normal_.dot(origin_ - pose.p_world_cam) / normal_.dot(ray));
  }

  [[nodiscard]] Eigen::Vector2d pixel(const CameraPose& pose, const Eigen::Vector3d& point) const {
    const Eigen::Vector3d p_cam = pose.R_world_cam.transpose() * (point - pose.p_world_cam);
    return project(camera_, p_cam.hnormalized());
  }

  [[nodiscard]] cv::Mat image(const CameraPose& pose, double noise = 1.5,
                              int noise_seed = 1) const {
    const Eigen::Matrix3d H = texture_from_bearing(pose);
    cv::Mat map(camera_.height, camera_.width, CV_32FC2);
    auto* out = map.ptr<float>();
    for (const Eigen::Vector2d& bearing : bearings_) {
      const double x = bearing[0], y = bearing[1];
      const double w = H(2, 0) * x + H(2, 1) * y + H(2, 2);
      *out++ = static_cast<float>((H(0, 0) * x + H(0, 1) * y + H(0, 2)) / w);
      *out++ = static_cast<float>((H(1, 0) * x + H(1, 1) * y + H(1, 2)) / w);
    }
    cv::Mat shades, grey;
    cv::remap(texture_, shades, map, cv::noArray(), cv::INTER_LINEAR, cv::BORDER_REFLECT);
    cv::Mat grain(shades.size(), CV_32F);
    cv::RNG random(static_cast<std::uint64_t>(noise_seed));
    random.fill(grain, cv::RNG::NORMAL, 0.0, noise);
    shades += grain;
    shades.convertTo(grey, CV_8U);
    return grey;
  }

 private:
  // Homography from (x/z, y/z, 1) in cam to the texture: what `point` does, for all pixels at once.
  [[nodiscard]] Eigen::Matrix3d texture_from_bearing(const CameraPose& pose) const {
    const Eigen::RowVector3d along = normal_.transpose() * pose.R_world_cam;
    const double distance = normal_.dot(origin_ - pose.p_world_cam);
    const Eigen::Matrix3d from_bearing = pose.p_world_cam * along + distance * pose.R_world_cam;
    Eigen::Matrix3d H;
    H.row(0) = from_bearing.row(0) / kTexel + along * kTextureSide / 2;
    H.row(1) = from_bearing.row(1) / kTexel + along * kTextureSide / 2;
    H.row(2) = along;
    return H;
  }

  static constexpr int kTextureSide = 1024;
  static constexpr double kTexel = 0.016;  // m, nearly a pixel at 4 m

  CameraIntrinsics camera_;
  cv::Mat texture_;
  Eigen::Vector3d origin_ = Eigen::Vector3d(0, 0, 4);
  Eigen::Vector3d normal_ = Eigen::Vector3d(0.35, -0.2, -1).normalized();
  std::vector<Eigen::Vector2d> bearings_;
};

// A drone that hovers badly: sideways, up and down, forth, and turning on all axes.
inline CameraPose swaying_pose(double t) {
  CameraPose pose;
  pose.p_world_cam << 0.6 * std::sin(1.1 * t), 0.3 * std::sin(1.7 * t), 0.8 * std::sin(0.6 * t);
  pose.R_world_cam =
      exp_so3({0.1 * std::sin(1.9 * t), 0.15 * std::sin(1.3 * t), 0.25 * std::sin(0.9 * t)});
  return pose;
}

constexpr TimeNs kFramePeriod = 33'333'333;  // ns
inline double frame_time(int k) { return static_cast<double>(k) * 1e-9 * kFramePeriod; }

}  // namespace covey::testing_view
