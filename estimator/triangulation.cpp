// SPDX-License-Identifier: Apache-2.0
#include "estimator/triangulation.h"

#include <Eigen/Cholesky>
#include <Eigen/Dense>
#include <cmath>

#include "estimator/bearing.h"

namespace covey {
namespace {

constexpr int kMaxIterations = 8;
constexpr double kConverged = 1e-6;  // relative change of the parameters

// The point closest to all rays, in the first view's camera frame.
std::optional<Eigen::Vector3d> closest_point(const std::vector<View>& views) {
  const CameraPose& first = views.front().camera;
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const View& view : views) {
    const Eigen::Vector3d ray = first.R_world_cam.transpose() * view.camera.R_world_cam *
                                view.bearing.homogeneous().normalized();
    const Eigen::Vector3d origin =
        first.R_world_cam.transpose() * (view.camera.p_world_cam - first.p_world_cam);
    const Eigen::Matrix3d off_ray = Eigen::Matrix3d::Identity() - ray * ray.transpose();
    A += off_ray;
    b += off_ray * origin;
  }
  const Eigen::LDLT<Eigen::Matrix3d> solver(A);
  if (solver.info() != Eigen::Success || solver.rcond() < 1e-12) return std::nullopt;
  return solver.solve(b);
}

struct NormalEquations {
  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  double cost = 0;
  bool in_front = true;
};

// Residuals of h = R (alpha, beta, 1) + rho t, whitened.
NormalEquations linearize(const std::vector<View>& views, const Eigen::Vector3d& inverse_depth) {
  const CameraPose& first = views.front().camera;
  NormalEquations sum;
  for (const View& view : views) {
    const Eigen::Matrix3d R = view.camera.R_world_cam.transpose() * first.R_world_cam;
    const Eigen::Vector3d t =
        view.camera.R_world_cam.transpose() * (first.p_world_cam - view.camera.p_world_cam);
    const Eigen::Vector3d h =
        R * Eigen::Vector3d(inverse_depth.x(), inverse_depth.y(), 1) + inverse_depth.z() * t;
    if (h.z() < 1e-6) {
      sum.in_front = false;
      return sum;
    }
    const Eigen::Vector2d predicted = h.head<2>() / h.z();
    const Matrix23d J_h = view.whitening * bearing_by_point_at_depth_1(predicted) / h.z();
    Eigen::Matrix3d J_parameters;
    J_parameters << R.col(0), R.col(1), t;
    const Matrix23d J = J_h * J_parameters;
    const Eigen::Vector2d residual = view.whitening * (view.bearing - predicted);
    sum.A += J.transpose() * J;
    sum.b += J.transpose() * residual;
    sum.cost += residual.squaredNorm();
  }
  return sum;
}

}  // namespace

std::optional<Triangulation> triangulate(const std::vector<View>& views,
                                         const DepthLimits& limits) {
  if (views.size() < 2) return std::nullopt;
  const auto start = closest_point(views);
  if (!start || start->z() < limits.min_m / 2) return std::nullopt;
  Eigen::Vector3d inverse_depth(start->x() / start->z(), start->y() / start->z(), 1 / start->z());

  NormalEquations equations = linearize(views, inverse_depth);
  for (int i = 0; i < kMaxIterations && equations.in_front; ++i) {
    const Eigen::Vector3d step = equations.A.ldlt().solve(equations.b);
    const Eigen::Vector3d candidate = inverse_depth + step;
    const NormalEquations next = linearize(views, candidate);
    if (!next.in_front || next.cost > equations.cost) break;
    inverse_depth = candidate;
    equations = next;
    if (step.norm() < kConverged * inverse_depth.norm()) break;
  }
  if (!equations.in_front) return std::nullopt;
  const double depth = 1 / inverse_depth.z();
  if (!(depth > limits.min_m && depth < limits.max_m)) return std::nullopt;

  const double rho_variance = equations.A.inverse()(2, 2);
  if (!(rho_variance > 0) || !std::isfinite(rho_variance)) return std::nullopt;
  const CameraPose& first = views.front().camera;
  Triangulation result;
  result.p_world =
      first.p_world_cam +
      first.R_world_cam * (depth * Eigen::Vector3d(inverse_depth.x(), inverse_depth.y(), 1));
  result.relative_depth_error = std::sqrt(rho_variance) * depth;
  return result;
}

}  // namespace covey
