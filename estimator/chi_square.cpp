// SPDX-License-Identifier: Apache-2.0
#include "estimator/chi_square.h"

#include <cmath>

namespace covey {
namespace {

// As POSIX has it: std::lgamma tells the sign in a variable that all threads share.
double log_gamma(double x) {
  int sign = 0;
  return ::lgamma_r(x, &sign);
}

}  // namespace

double chi_square_cdf(double value, int degrees_of_freedom) {
  if (value <= 0) return 0;
  const double a = degrees_of_freedom / 2.0;
  const double x = value / 2;
  // Series of the regularised lower incomplete gamma function (Abramowitz and Stegun, 6.5.29); its
  // terms are all positive, so it is exact enough for every x we meet.
  double term = 1 / a;
  double sum = term;
  for (int n = 1; n < 2000; ++n) {
    term *= x / (a + n);
    sum += term;
    if (term < 1e-15 * sum) break;
  }
  return sum * std::exp(a * std::log(x) - x - log_gamma(a));
}

double chi_square_quantile(double confidence, int degrees_of_freedom) {
  double low = 0;
  double high = degrees_of_freedom + 20 * std::sqrt(2.0 * degrees_of_freedom) + 20;
  for (int i = 0; i < 100; ++i) {
    const double middle = (low + high) / 2;
    (chi_square_cdf(middle, degrees_of_freedom) < confidence ? low : high) = middle;
  }
  return (low + high) / 2;
}

ChiSquareGate::ChiSquareGate(double confidence, int max_degrees) : confidence_(confidence) {
  limits_.reserve(static_cast<std::size_t>(max_degrees) + 1);
  limits_.push_back(0);
  for (int degrees = 1; degrees <= max_degrees; ++degrees) {
    limits_.push_back(chi_square_quantile(confidence, degrees));
  }
}

double ChiSquareGate::limit(int degrees_of_freedom) const {
  const auto index = static_cast<std::size_t>(degrees_of_freedom);
  return index < limits_.size() ? limits_[index]
                                : chi_square_quantile(confidence_, degrees_of_freedom);
}

}  // namespace covey
