// SPDX-License-Identifier: Apache-2.0
#include "frontend/camera.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

namespace covey {
namespace {

struct Distorted {
  Eigen::Vector2d point = Eigen::Vector2d::Zero();  // distorted, normalised plane
  Eigen::Matrix2d J = Eigen::Matrix2d::Identity();  // d(point)/d(bearing)
};

// Brown 1966; OpenCV's order k1 k2 p1 p2.
Distorted radial_tangential(const std::array<double, 4>& k, const Eigen::Vector2d& bearing) {
  const double x = bearing.x(), y = bearing.y();
  const double r2 = x * x + y * y;
  const double radial = 1 + r2 * (k[0] + r2 * k[1]);
  const double radial_r2 = k[0] + 2 * r2 * k[1];  // d(radial)/d(r2)
  Distorted d;
  d.point.x() = x * radial + 2 * k[2] * x * y + k[3] * (r2 + 2 * x * x);
  d.point.y() = y * radial + k[2] * (r2 + 2 * y * y) + 2 * k[3] * x * y;
  const double cross = 2 * x * y * radial_r2 + 2 * k[2] * x + 2 * k[3] * y;
  d.J(0, 0) = radial + 2 * x * x * radial_r2 + 2 * k[2] * y + 6 * k[3] * x;
  d.J(0, 1) = cross;
  d.J(1, 0) = cross;
  d.J(1, 1) = radial + 2 * y * y * radial_r2 + 6 * k[2] * y + 2 * k[3] * x;
  return d;
}

double radial_tangential_slope(const std::array<double, 4>& k, double r) {
  const double r2 = r * r;
  return 1 + r2 * (3 * k[0] + r2 * 5 * k[1]);
}

double equidistant_angle(const std::array<double, 4>& k, double theta) {
  const double t2 = theta * theta;
  return theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
}

double equidistant_slope(const std::array<double, 4>& k, double theta) {
  const double t2 = theta * theta;
  return 1 + t2 * (3 * k[0] + t2 * (5 * k[1] + t2 * (7 * k[2] + t2 * 9 * k[3])));
}

// Kannala and Brandt 2006, eq. 6, without the even and asymmetric terms.
Distorted equidistant(const std::array<double, 4>& k, const Eigen::Vector2d& bearing) {
  const double r = bearing.norm();
  const double theta = std::atan(r);
  // Below 1e-4 the series of theta_d / r is exact to double precision where it matters.
  const bool central = r < 1e-4;
  const double scale = central ? 1 + (k[0] - 1.0 / 3) * r * r : equidistant_angle(k, theta) / r;
  const double slope_r = equidistant_slope(k, theta) / (1 + r * r);  // d(theta_d)/dr
  const double scale_r_over_r = central ? 2 * (k[0] - 1.0 / 3) : (slope_r - scale) / (r * r);
  Distorted d;
  d.point = scale * bearing;
  d.J = scale * Eigen::Matrix2d::Identity() + scale_r_over_r * bearing * bearing.transpose();
  return d;
}

// A distortion polynomial that turns back gives one pixel two bearings; only the inner one is real.
template <typename Slope>
bool grows_up_to(const std::array<double, 4>& k, double limit, Slope slope) {
  constexpr int kSamples = 16;
  for (int i = 1; i <= kSamples; ++i) {
    if (slope(k, limit * i / kSamples) <= 0) return false;
  }
  return true;
}

constexpr int kMaxIterations = 30;
constexpr double kTolerance = 1e-12;  // normalised plane

std::optional<Eigen::Vector2d> invert_radial_tangential(const std::array<double, 4>& k,
                                                        const Eigen::Vector2d& distorted) {
  Eigen::Vector2d bearing = distorted;
  for (int i = 0; i < kMaxIterations; ++i) {
    const Distorted d = radial_tangential(k, bearing);
    const Eigen::Vector2d error = distorted - d.point;
    if (error.squaredNorm() < kTolerance * kTolerance) {
      if (!grows_up_to(k, bearing.norm(), radial_tangential_slope)) return std::nullopt;
      return bearing;
    }
    if (d.J.determinant() <= 0) return std::nullopt;
    bearing += d.J.inverse() * error;
  }
  return std::nullopt;
}

std::optional<Eigen::Vector2d> invert_equidistant(const std::array<double, 4>& k,
                                                  const Eigen::Vector2d& distorted) {
  constexpr double kLimit = 0.5 * M_PI - 1e-3;  // rad; beyond it nothing lies on the z = 1 plane
  const double theta_d = distorted.norm();
  if (theta_d < kTolerance) return distorted;
  double theta = std::min(theta_d, kLimit);
  for (int i = 0; i < kMaxIterations; ++i) {
    const double error = theta_d - equidistant_angle(k, theta);
    if (std::abs(error) < kTolerance) {
      if (theta >= kLimit || !grows_up_to(k, theta, equidistant_slope)) return std::nullopt;
      return distorted * (std::tan(theta) / theta_d);
    }
    const double slope = equidistant_slope(k, theta);
    if (slope <= 0) return std::nullopt;
    theta += error / slope;
    if (!(theta > 0)) return std::nullopt;
  }
  return std::nullopt;
}

}  // namespace

Eigen::Vector2d project(const CameraIntrinsics& camera, const Eigen::Vector2d& bearing,
                        Eigen::Matrix2d* J_pixel_bearing) {
  const Distorted d = camera.model == DistortionModel::kEquidistant
                          ? equidistant(camera.distortion, bearing)
                          : radial_tangential(camera.distortion, bearing);
  const Eigen::Vector2d focal(camera.fx, camera.fy);
  if (J_pixel_bearing != nullptr) *J_pixel_bearing = focal.asDiagonal() * d.J;
  return focal.cwiseProduct(d.point) + Eigen::Vector2d(camera.cx, camera.cy);
}

Eigen::Matrix2d px_per_bearing(const CameraIntrinsics& camera, const Eigen::Vector2d& bearing) {
  Eigen::Matrix2d J;
  [[maybe_unused]] const Eigen::Vector2d pixel = project(camera, bearing, &J);
  return J;
}

Eigen::Matrix2d bearing_covariance(const CameraIntrinsics& camera, const Eigen::Vector2d& bearing,
                                   const Eigen::Matrix2d& pixel_covariance) {
  const Eigen::Matrix2d to_bearing = px_per_bearing(camera, bearing).inverse();
  return to_bearing * pixel_covariance * to_bearing.transpose();
}

// The pixel stays: J d(bearing) = -[(u - cx) dfx/fx + fx dcx/fx + ..., ...], and the bearing is
// wrong by minus that.
BearingByIntrinsics bearing_by_intrinsics(const CameraIntrinsics& camera,
                                          const Eigen::Vector2d& bearing) {
  Eigen::Matrix2d J;
  const Eigen::Vector2d pixel = project(camera, bearing, &J);
  // Of the distorted point, by k1: the bearing's direction times r^3 or theta^3.
  const double r = bearing.norm();
  const bool equidistant = camera.model == DistortionModel::kEquidistant;
  const double radius = equidistant ? std::atan(r) : r;
  const double shrunk = r > 0 ? radius / r : 1;
  const Eigen::Vector2d by_k1 =
      radius * radius * shrunk * bearing.cwiseProduct(Eigen::Vector2d(camera.fx, camera.fy));
  BearingByIntrinsics of_pixel;
  of_pixel << pixel.x() - camera.cx, 0, camera.fx, 0, by_k1.x(), radius * radius * by_k1.x(),  //
      0, pixel.y() - camera.cy, 0, camera.fy, by_k1.y(), radius * radius * by_k1.y();
  return J.inverse() * of_pixel;
}

CameraIntrinsics corrected(CameraIntrinsics camera, const IntrinsicsError& error) {
  camera.cx += camera.fx * error[2];
  camera.cy += camera.fy * error[3];
  camera.fx *= 1 + error[0];
  camera.fy *= 1 + error[1];
  camera.distortion[0] += error[4];
  camera.distortion[1] += error[5];
  return camera;
}

bool is_on_lens(const CameraIntrinsics& camera, const Eigen::Vector2d& bearing) {
  const double r = bearing.norm();
  return camera.model == DistortionModel::kEquidistant
             ? grows_up_to(camera.distortion, std::atan(r), equidistant_slope)
             : grows_up_to(camera.distortion, r, radial_tangential_slope);
}

std::optional<Eigen::Vector2d> unproject(const CameraIntrinsics& camera,
                                         const Eigen::Vector2d& pixel) {
  const Eigen::Vector2d distorted((pixel.x() - camera.cx) / camera.fx,
                                  (pixel.y() - camera.cy) / camera.fy);
  if (!distorted.allFinite()) return std::nullopt;
  return camera.model == DistortionModel::kEquidistant
             ? invert_equidistant(camera.distortion, distorted)
             : invert_radial_tangential(camera.distortion, distorted);
}

}  // namespace covey
