// SPDX-License-Identifier: Apache-2.0
#include "estimator/covariance_intersection.h"

#include <Eigen/LU>
#include <cmath>

namespace covey {
namespace {

constexpr int kIterations = 24;        // each shrinks the interval to 62 %
constexpr double kLeastWeight = 1e-4;  // of either: nothing is divided by zero

// A Kalman update of A / w by B / (1 - w).
Intersection intersection_at(double w, const Eigen::Matrix4d& A, const Eigen::Matrix4d& B) {
  const Eigen::Matrix4d scaled = A / w;
  Intersection result;
  result.K = scaled * (scaled + B / (1 - w)).inverse();
  const Eigen::Matrix4d C = scaled - result.K * scaled;
  result.covariance = (C + C.transpose()) / 2;
  return result;
}

}  // namespace

Intersection intersect_covariances(const Eigen::Matrix4d& A, const Eigen::Matrix4d& B,
                                   const Eigen::Matrix4d& Q) {
  const auto cost = [&](double w) { return (Q * intersection_at(w, A, B).covariance).trace(); };
  // The cost is convex in w: golden section.
  const double ratio = (std::sqrt(5.0) - 1) / 2;
  double low = kLeastWeight, high = 1 - kLeastWeight;
  double left = high - ratio * (high - low), right = low + ratio * (high - low);
  double cost_left = cost(left), cost_right = cost(right);
  for (int i = 0; i < kIterations; ++i) {
    if (cost_left < cost_right) {
      high = right;
      right = left;
      cost_right = cost_left;
      left = high - ratio * (high - low);
      cost_left = cost(left);
    } else {
      low = left;
      left = right;
      cost_left = cost_right;
      right = low + ratio * (high - low);
      cost_right = cost(right);
    }
  }
  const Intersection best = intersection_at((low + high) / 2, A, B);
  if ((Q * A).trace() <= (Q * best.covariance).trace()) return {Eigen::Matrix4d::Zero(), A};
  return best;
}

}  // namespace covey
