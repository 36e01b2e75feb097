// SPDX-License-Identifier: Apache-2.0
#include "frontend/geometric_verification.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <utility>

#include "estimator/bearing.h"

namespace covey {
namespace {

// One correspondence about the own camera's position c: R q + offset = depth * ray.
struct Constraint {
  Eigen::Vector3d q;    // p_world_peer - c
  Eigen::Vector3d ray;  // in the own world, of depth 1
};

Constraint to_constraint(const Eigen::Isometry3d& T_world_cam, const Correspondence& match) {
  return {match.p_world_peer - T_world_cam.translation(),
          T_world_cam.linear() * match.bearing_own.homogeneous()};
}

Eigen::Matrix3d rotation_about_z(double yaw) {
  return Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()).toRotationMatrix();
}

double cross_2d(const Eigen::Vector2d& a, const Eigen::Vector2d& b) {
  return a.x() * b.y() - a.y() * b.x();
}

std::vector<double> real_roots(double a, double b, double c) {
  const double discriminant = b * b - 4 * a * c;
  if (!(std::abs(a) > 1e-12) || !(discriminant >= 0)) return {};
  const double root = std::sqrt(discriminant);
  return {(-b + root) / (2 * a), (-b - root) / (2 * a)};
}

// `steep` has the larger vertical component of the two rays. With D = q_steep - q_other,
// R D = l_steep ray_steep - l_other ray_other: its z gives l_steep as a linear function of l_other,
// its horizontal length a quadratic equation, its horizontal direction the yaw.
std::vector<FrameOffset> solve(const Constraint& steep, const Constraint& other) {
  const Eigen::Vector3d difference = steep.q - other.q;
  const double D2 = difference.head<2>().squaredNorm();
  if (!(std::abs(steep.ray.z()) > 1e-6) || !(D2 > 1e-12)) return {};
  const double k = difference.z() / steep.ray.z(), m = other.ray.z() / steep.ray.z();
  const Eigen::Vector2d u = m * steep.ray.head<2>() - other.ray.head<2>();
  const Eigen::Vector2d w = k * steep.ray.head<2>();  // horizontal: R D = l_other u + w

  std::vector<FrameOffset> offsets;
  for (const double depth : real_roots(u.squaredNorm(), 2 * u.dot(w), w.squaredNorm() - D2)) {
    if (!(depth > 0) || !(k + m * depth > 0)) continue;
    const Eigen::Vector2d turned = depth * u + w;
    FrameOffset offset;
    offset.yaw =
        std::atan2(cross_2d(difference.head<2>(), turned), difference.head<2>().dot(turned));
    offset.offset = depth * other.ray - rotation_about_z(offset.yaw) * other.q;
    offsets.push_back(offset);
  }
  return offsets;
}

class Verifier {
 public:
  Verifier(const Eigen::Isometry3d& T_world_cam, const std::vector<Correspondence>& matches,
           const CameraIntrinsics& camera, double inlier_px)
      : T_world_cam_(T_world_cam),
        R_cam_world_(T_world_cam.linear().transpose()),
        matches_(matches),
        gate2_(inlier_px * inlier_px) {
    lens_.reserve(matches.size());
    for (const Correspondence& match : matches) {
      lens_.push_back(px_per_bearing(camera, match.bearing_own));
    }
  }

  // Sum of the squared errors, each at most the gate (MSAC, Torr and Zisserman 2000).
  [[nodiscard]] double cost(const FrameOffset& offset) const {
    double sum = 0;
    for (std::size_t i = 0; i < matches_.size(); ++i) sum += std::min(gate2_, error2(offset, i));
    return sum;
  }

  [[nodiscard]] std::vector<std::size_t> inliers(const FrameOffset& offset) const {
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < matches_.size(); ++i) {
      if (error2(offset, i) < gate2_) indices.push_back(i);
    }
    return indices;
  }

  // Gauss-Newton on the reprojection errors of the inliers, as long as it helps.
  [[nodiscard]] FrameOffset refine(FrameOffset offset) const {
    constexpr int kIterations = 10;
    double least = cost(offset);
    for (int i = 0; i < kIterations; ++i) {
      const FrameOffset next = step(offset);
      const double next_cost = cost(next);
      if (!(next_cost < least)) break;
      least = next_cost;
      offset = next;
    }
    return offset;
  }

  // Largest standard deviation of the offset, m, when the inliers are right to 1 px.
  [[nodiscard]] double offset_sigma(const FrameOffset& offset) const {
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> information(linearise(offset).A);
    if (!(information.eigenvalues()[0] > 1e-12 * information.eigenvalues()[3])) {
      return std::numeric_limits<double>::infinity();
    }
    const Eigen::Matrix4d covariance = information.eigenvectors() *
                                       information.eigenvalues().cwiseInverse().asDiagonal() *
                                       information.eigenvectors().transpose();
    return std::sqrt(covariance.bottomRightCorner<3, 3>().eigenvalues().real().maxCoeff());
  }

 private:
  [[nodiscard]] Eigen::Vector3d in_camera(const FrameOffset& offset,
                                          const Correspondence& m) const {
    return R_cam_world_ * (to_own_world(offset, T_world_cam_.translation(), m.p_world_peer) -
                           T_world_cam_.translation());
  }

  // px^2
  [[nodiscard]] double error2(const FrameOffset& offset, std::size_t i) const {
    const Eigen::Vector3d p_cam = in_camera(offset, matches_[i]);
    if (!(p_cam.z() > 1e-3)) return std::numeric_limits<double>::infinity();
    return (lens_[i] * (p_cam.hnormalized() - matches_[i].bearing_own)).squaredNorm();
  }

  // Normal equations A delta = b of the inliers' errors in px, delta = [yaw, offset].
  struct Normal {
    Eigen::Matrix4d A = Eigen::Matrix4d::Zero();
    Eigen::Vector4d b = Eigen::Vector4d::Zero();
  };

  [[nodiscard]] Normal linearise(const FrameOffset& offset) const {
    Normal normal;
    for (const std::size_t i : inliers(offset)) {
      const Eigen::Vector3d p_cam = in_camera(offset, matches_[i]);
      const Eigen::Vector2d bearing = p_cam.hnormalized();
      const Matrix23d J_px_cam = lens_[i] * bearing_by_point_at_depth_1(bearing) / p_cam.z();
      const Eigen::Vector3d turned = R_cam_world_.transpose() * p_cam - offset.offset;
      Eigen::Matrix<double, 2, 4> J;
      J << J_px_cam * R_cam_world_ * Eigen::Vector3d::UnitZ().cross(turned),
          J_px_cam * R_cam_world_;
      normal.A += J.transpose() * J;
      normal.b += J.transpose() * lens_[i] * (matches_[i].bearing_own - bearing);
    }
    return normal;
  }

  [[nodiscard]] FrameOffset step(const FrameOffset& offset) const {
    const Normal normal = linearise(offset);
    const Eigen::Vector4d delta = normal.A.ldlt().solve(normal.b);
    if (!delta.allFinite()) return offset;
    return {offset.yaw + delta[0], offset.offset + delta.tail<3>()};
  }

  Eigen::Isometry3d T_world_cam_;
  Eigen::Matrix3d R_cam_world_;
  const std::vector<Correspondence>& matches_;
  std::vector<Eigen::Matrix2d> lens_;  // px per unit of bearing, where each is seen
  double gate2_;                       // squared error of an inlier, px^2
};

// Draws of two after which two inliers were drawn together with 99.9 % (Fischler and Bolles 1981).
int draws_needed(std::size_t inliers, std::size_t matches, int most) {
  const double share = static_cast<double>(inliers) / static_cast<double>(matches);
  const double missed = std::log1p(-std::min(share * share, 1 - 1e-9));
  return static_cast<int>(std::min<double>(most, std::ceil(std::log(1e-3) / missed)));
}

// Locally optimised: each better hypothesis is refined at once (Chum et al., LO-RANSAC, 2003).
FrameOffset best_offset(const Verifier& verifier, const Eigen::Isometry3d& T_world_cam,
                        const std::vector<Correspondence>& matches, int max_iterations) {
  FrameOffset best = verifier.refine(FrameOffset{});  // no drift at all is a good first guess
  double least = verifier.cost(best);
  int iterations = draws_needed(verifier.inliers(best).size(), matches.size(), max_iterations);
  std::mt19937 random(1);
  for (int i = 0; i < iterations; ++i) {
    const std::size_t first = random() % matches.size(), second = random() % matches.size();
    if (first == second) continue;
    for (const FrameOffset& offset :
         offsets_from_two_points(T_world_cam, matches[first], matches[second])) {
      if (!(verifier.cost(offset) < least)) continue;
      best = verifier.refine(offset);
      least = verifier.cost(best);
      iterations = draws_needed(verifier.inliers(best).size(), matches.size(), max_iterations);
    }
  }
  return best;
}

}  // namespace

Eigen::Vector3d to_own_world(const FrameOffset& offset, const Eigen::Vector3d& c,
                             const Eigen::Vector3d& p_world_peer) {
  return c + offset.offset + rotation_about_z(offset.yaw) * (p_world_peer - c);
}

std::vector<FrameOffset> offsets_from_two_points(const Eigen::Isometry3d& T_world_cam,
                                                 const Correspondence& first,
                                                 const Correspondence& second) {
  const Constraint a = to_constraint(T_world_cam, first), b = to_constraint(T_world_cam, second);
  return std::abs(a.ray.z()) > std::abs(b.ray.z()) ? solve(a, b) : solve(b, a);
}

VerificationResult verify(const Eigen::Isometry3d& T_world_cam,
                          const std::vector<Correspondence>& correspondences,
                          const CameraIntrinsics& camera, const VerificationConfig& config) {
  const double needed = std::max<double>(
      config.min_inliers, config.min_inlier_share * static_cast<double>(correspondences.size()));
  if (static_cast<double>(correspondences.size()) < needed || correspondences.size() < 2) {
    return {std::nullopt, VerificationFailure::kTooFewCorrespondences};
  }
  const Verifier verifier(T_world_cam, correspondences, camera, config.inlier_px);
  const FrameOffset offset =
      best_offset(verifier, T_world_cam, correspondences, config.max_iterations);
  Verified verified{offset, verifier.inliers(offset)};
  if (static_cast<double>(verified.inliers.size()) < needed) {
    return {std::nullopt, VerificationFailure::kTooFewInliers};
  }
  if (verifier.offset_sigma(offset) > config.max_offset_sigma) {
    return {std::nullopt, VerificationFailure::kUndetermined};
  }
  if (!(offset.offset.norm() <= config.max_offset) || !(std::abs(offset.yaw) <= config.max_yaw)) {
    return {std::nullopt, VerificationFailure::kOffsetTooLarge};
  }
  return {std::move(verified), {}};
}

}  // namespace covey
