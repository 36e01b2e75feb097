// SPDX-License-Identifier: Apache-2.0
//
// Compares an analytic Jacobian with central differences of the function itself.
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <string>

namespace covey {

// d(f)/d(delta) at delta = 0 by central differences; `f` takes an increment of `size` elements (of
// a vector, or of a rotation by way of Exp) and returns a vector.
template <typename Function>
Eigen::MatrixXd numeric_jacobian(const Function& f, Eigen::Index size, double step = 1e-5) {
  Eigen::MatrixXd J;
  for (Eigen::Index i = 0; i < size; ++i) {
    Eigen::VectorXd delta = Eigen::VectorXd::Zero(size);
    delta[i] = step;
    const Eigen::VectorXd ahead = f(delta);
    const Eigen::VectorXd behind = f(-delta);
    if (i == 0) J.resize(ahead.size(), size);
    J.col(i) = (ahead - behind) / (2 * step);
  }
  return J;
}

// The message holds the name, both matrices and the norm of their difference. `tolerance` is
// relative to the largest element, with 1 as the least.
template <typename Function>
void expect_jacobian(const std::string& name, const Eigen::MatrixXd& analytic, const Function& f,
                     double tolerance = 1e-6, double step = 1e-5) {
  ASSERT_TRUE(analytic.allFinite()) << name << " is not finite:\n" << analytic;
  const Eigen::MatrixXd numeric = numeric_jacobian(f, analytic.cols(), step);
  ASSERT_EQ(analytic.rows(), numeric.rows()) << name;
  ASSERT_TRUE(numeric.allFinite()) << name << ": the function itself is not finite";
  const double scale = std::max(1.0, numeric.cwiseAbs().maxCoeff());
  const double difference = (analytic - numeric).cwiseAbs().maxCoeff();
  EXPECT_LE(difference, tolerance * scale)
      << name << "\nanalytic (norm " << analytic.norm() << "):\n"
      << analytic << "\nnumeric (norm " << numeric.norm() << "):\n"
      << numeric;
}

}  // namespace covey
