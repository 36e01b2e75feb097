// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace covey {

constexpr double kOutlierChiSquare = 9.21;  // 1 % of what has 2 degrees of freedom lies beyond

// Share of chi-square distributed values with `degrees_of_freedom` that lie below `value`.
[[nodiscard]] double chi_square_cdf(double value, int degrees_of_freedom);

// The value below which the share `confidence` (0..1) lies.
[[nodiscard]] double chi_square_quantile(double confidence, int degrees_of_freedom);

// Quantiles of one confidence for 1..max_degrees, computed once.
class ChiSquareGate {
 public:
  ChiSquareGate(double confidence, int max_degrees);
  [[nodiscard]] double limit(int degrees_of_freedom) const;

 private:
  double confidence_;
  std::vector<double> limits_;
};

}  // namespace covey
