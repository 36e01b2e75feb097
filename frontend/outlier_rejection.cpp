// SPDX-License-Identifier: Apache-2.0
#include "frontend/outlier_rejection.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>

#include "estimator/so3.h"

namespace covey {
namespace {

// Unit rays of one point, both in the present camera's axes.
struct RayPair {
  Eigen::Vector3d before;
  Eigen::Vector3d now;
  Eigen::Vector3d normal;  // before x now: perpendicular to the translation if the point is fixed
};

using Rays = std::vector<RayPair>;

Rays to_rays(const std::vector<BearingPair>& pairs, const Eigen::Matrix3d& R_now_before) {
  Rays rays;
  rays.reserve(pairs.size());
  for (const BearingPair& pair : pairs) {
    RayPair ray;
    ray.before = (R_now_before * pair.before.homogeneous()).normalized();
    ray.now = pair.now.homogeneous().normalized();
    ray.normal = ray.before.cross(ray.now);
    rays.push_back(ray);
  }
  return rays;
}

// Sine of the angle between a ray and its epipolar plane.
double plane_distance(const RayPair& ray, const Eigen::Vector3d& direction) {
  constexpr double kAtEpipole = 1e-6;
  return direction.dot(ray.normal) / std::max(direction.cross(ray.before).norm(), kAtEpipole);
}

std::vector<double> plane_distances(const Rays& rays, const Eigen::Vector3d& direction) {
  std::vector<double> distances;
  distances.reserve(rays.size());
  for (const RayPair& ray : rays) distances.push_back(std::abs(plane_distance(ray, direction)));
  return distances;
}

// From the median of absolute values, which half of the tracks may not reach by being wrong.
double robust_deviation(std::vector<double> distances) {
  const auto middle = distances.begin() + static_cast<std::ptrdiff_t>(distances.size() / 2);
  std::nth_element(distances.begin(), middle, distances.end());
  return 1.4826 * *middle;
}

// Truncated squares (MSAC, Torr and Zisserman 2000).
double cost(const Rays& rays, const Eigen::Vector3d& direction, double limit) {
  double sum = 0;
  for (const RayPair& ray : rays) {
    const double distance = plane_distance(ray, direction);
    sum += std::min(distance * distance, limit * limit);
  }
  return sum;
}

Eigen::Vector3d ransac_direction(const Rays& rays, double limit, int iterations) {
  std::minstd_rand random(1);  // same tracks, same verdict
  Eigen::Vector3d best = Eigen::Vector3d::UnitZ();
  double best_cost = cost(rays, best, limit);
  for (int i = 0; i < iterations; ++i) {
    const RayPair& a = rays[random() % rays.size()];
    const RayPair& b = rays[random() % rays.size()];
    const Eigen::Vector3d direction = a.normal.cross(b.normal);
    const double norm = direction.norm();
    if (norm < 1e-12) continue;
    const double this_cost = cost(rays, direction / norm, limit);
    if (this_cost < best_cost) {
      best_cost = this_cost;
      best = direction / norm;
    }
  }
  return best;
}

struct Motion {
  Eigen::Vector3d direction;                                 // of translation, unit
  Eigen::Vector3d rotation_error = Eigen::Vector3d::Zero();  // rad, of R_now_before, left side
};

// Gauss-Newton with Cauchy weights over the direction and the error of the gyro's rotation: a bias
// that nobody has estimated yet must not throw out good tracks.
Motion refine(const Rays& rays, Motion motion, double scale, double rotation_sigma) {
  constexpr int kIterations = 5;
  for (int i = 0; i < kIterations; ++i) {
    const Eigen::Vector3d& t = motion.direction;
    const Eigen::Vector3d side = t.unitOrthogonal();
    Eigen::Matrix<double, 3, 2> tangent;
    tangent << side, t.cross(side);
    Eigen::Matrix<double, 5, 5> H = Eigen::Matrix<double, 5, 5>::Identity() * 1e-9;
    const double prior = 1 / (rotation_sigma * rotation_sigma);
    H.topLeftCorner<3, 3>() += prior * Eigen::Matrix3d::Identity();
    Eigen::Matrix<double, 5, 1> g = Eigen::Matrix<double, 5, 1>::Zero();
    g.head<3>() = prior * motion.rotation_error;
    for (const RayPair& ray : rays) {
      // (dtheta x before) x now = before (now . dtheta) - dtheta (before . now)
      const Eigen::Vector3d turned = ray.before + motion.rotation_error.cross(ray.before);
      const double inverse_norm = 1 / std::max(t.cross(turned).norm(), 1e-6);
      const Eigen::Vector3d normal = turned.cross(ray.now);
      const double e = t.dot(normal) * inverse_norm;
      Eigen::Matrix<double, 5, 1> J;
      J.head<3>() = (t.dot(turned) * ray.now - turned.dot(ray.now) * t) * inverse_norm;
      J.tail<2>() = tangent.transpose() * normal * inverse_norm;
      const double weight = 1 / (scale * scale + e * e);
      H += weight * J * J.transpose();
      g += weight * e * J;
    }
    const Eigen::Matrix<double, 5, 1> step = -H.ldlt().solve(g);
    if (!step.allFinite()) break;
    motion.rotation_error += step.head<3>();
    motion.direction = (t + tangent * step.tail<2>()).normalized();
  }
  return motion;
}

// Positive where the point lies before the camera for this direction of translation, negative where
// it would lie behind; 0 where the parallax is too small to tell.
int depth_sign(const RayPair& ray, const Eigen::Vector3d& direction, double telling_parallax) {
  if (ray.normal.norm() < telling_parallax) return 0;
  return direction.cross(ray.now).dot(ray.normal) < 0 ? 1 : -1;
}

}  // namespace

std::vector<bool> rigid_scene_inliers(const std::vector<BearingPair>& pairs, const TwoViews& views,
                                      const OutlierConfig& config) {
  std::vector<bool> inliers(pairs.size(), true);
  if (pairs.size() < static_cast<std::size_t>(std::max(3, config.min_tracks))) return inliers;
  const double widest = config.max_epipolar_px / views.focal_px;
  const double narrowest = config.min_epipolar_px / views.focal_px;
  Rays rays = to_rays(pairs, views.R_now_before);
  Motion motion;
  motion.direction = ransac_direction(rays, widest, config.iterations);
  motion = refine(rays, motion, narrowest, views.rotation_sigma);
  rays = to_rays(pairs, exp_so3(motion.rotation_error) * views.R_now_before);

  const std::vector<double> distances = plane_distances(rays, motion.direction);
  const double limit =
      std::clamp(config.max_deviations * robust_deviation(distances), narrowest, widest);
  int votes = 0;
  for (const RayPair& ray : rays) votes += depth_sign(ray, motion.direction, 2 * limit);
  if (votes < 0) motion.direction = -motion.direction;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    inliers[i] = distances[i] < limit && depth_sign(rays[i], motion.direction, 2 * limit) >= 0;
  }
  const auto agreeing = std::count(inliers.begin(), inliers.end(), true);
  if (static_cast<double>(agreeing) < config.min_consensus * static_cast<double>(pairs.size())) {
    inliers.assign(pairs.size(), true);
  }
  return inliers;
}

}  // namespace covey
