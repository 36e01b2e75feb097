// SPDX-License-Identifier: Apache-2.0
//
// Weights of a uniform B-spline of order 6 (degree 5) in cumulative form: with control points c_i,
// the spline is c_i + sum_j value[j] (c_{i+j} - c_{i+j-1}), j = 1..5, within knot interval i.
#pragma once

#include <array>

namespace covey::bspline {

inline constexpr int kOrder = 6;

struct Weights {
  std::array<double, kOrder> value{};   // value[0] = 1
  std::array<double, kOrder> first{};   // d/dt, 1/s
  std::array<double, kOrder> second{};  // d2/dt2, 1/s2
};

using Blending = std::array<std::array<double, kOrder>, kOrder>;

constexpr double power(double base, int exponent) {
  double result = 1;
  for (int i = 0; i < exponent; ++i) result *= base;
  return result;
}

constexpr double binomial(int n, int k) {
  double result = 1;
  for (int i = 0; i < k; ++i) result = result * (n - i) / (i + 1);
  return result;
}

// Qin, "General matrix representations for B-splines" (2000), summed to the cumulative form: row j
// holds the coefficients of 1, u, .. u^5 of weight j.
constexpr Blending cumulative_blending() {
  Blending M{};
  for (int row = kOrder - 1; row >= 0; --row) {
    for (int n = 0; n < kOrder; ++n) {
      double sum = 0;
      for (int l = row; l < kOrder; ++l) {
        sum += ((l - row) % 2 == 0 ? 1 : -1) * binomial(kOrder, l - row) *
               power(kOrder - 1 - l, kOrder - 1 - n);
      }
      const double next = row + 1 < kOrder ? M[row + 1][n] : 0.0;
      M[row][n] = next + binomial(kOrder - 1, n) / 120.0 * sum;  // 120 = 5!
    }
  }
  return M;
}

inline Weights cumulative_weights(double u, double knot_interval_s) {
  static constexpr Blending M = cumulative_blending();
  const double rate = 1 / knot_interval_s;
  Weights w;
  for (int j = 0; j < kOrder; ++j) {
    const auto& m = M[j];
    w.value[j] = m[0] + u * (m[1] + u * (m[2] + u * (m[3] + u * (m[4] + u * m[5]))));
    w.first[j] = rate * (m[1] + u * (2 * m[2] + u * (3 * m[3] + u * (4 * m[4] + u * 5 * m[5]))));
    w.second[j] = rate * rate * (2 * m[2] + u * (6 * m[3] + u * (12 * m[4] + u * 20 * m[5])));
  }
  return w;
}

}  // namespace covey::bspline
