// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>

namespace covey {

// A factorisation alone does not notice what is not a number.
template <int N>
[[nodiscard]] bool is_positive_definite(const Eigen::Matrix<double, N, N>& P) {
  return P.allFinite() && Eigen::LLT<Eigen::Matrix<double, N, N>>(P).info() == Eigen::Success;
}

}  // namespace covey
