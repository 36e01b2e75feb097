// SPDX-License-Identifier: Apache-2.0
#include "estimator/covariance_intersection.h"

#include <Eigen/LU>
#include <cmath>

namespace covey {

IntersectedPoint intersect_covariances(const PointEstimate& a, const PointEstimate& b) {
  const Eigen::Matrix3d A = a.covariance.inverse();
  const Eigen::Matrix3d B = b.covariance.inverse();
  const auto fused_covariance = [&](double w) -> Eigen::Matrix3d {
    return (w * A + (1 - w) * B).inverse();
  };
  // The trace is convex in w: golden section.
  const double ratio = (std::sqrt(5.0) - 1) / 2;
  double low = 0, high = 1;
  double left = high - ratio * (high - low), right = low + ratio * (high - low);
  double trace_left = fused_covariance(left).trace(), trace_right = fused_covariance(right).trace();
  for (int i = 0; i < 24; ++i) {
    if (trace_left < trace_right) {
      high = right;
      right = left;
      trace_right = trace_left;
      left = high - ratio * (high - low);
      trace_left = fused_covariance(left).trace();
    } else {
      low = left;
      left = right;
      trace_left = trace_right;
      right = low + ratio * (high - low);
      trace_right = fused_covariance(right).trace();
    }
  }
  double w = (low + high) / 2;
  const double trace = fused_covariance(w).trace();
  if (a.covariance.trace() <= trace) w = 1;
  if (b.covariance.trace() < std::min(trace, a.covariance.trace())) w = 0;
  IntersectedPoint result;
  result.weight = w;
  result.fused.covariance = fused_covariance(w);
  result.fused.mean = result.fused.covariance * (w * A * a.mean + (1 - w) * B * b.mean);
  return result;
}

}  // namespace covey
