// SPDX-License-Identifier: Apache-2.0
//
// How far away SLAM features are, and how well that is known.
#pragma once

#include <optional>

#include "estimator/state.h"

namespace covey {

// Of one, in metres: standard deviation of its inverse depth over its value.
[[nodiscard]] double metric_depth_error(const State& state, int landmark);

// The same, but relative to the scale, median of all. Nothing where there is none.
[[nodiscard]] std::optional<double> median_depth_error(const State& state);

// m; zero while none is known.
[[nodiscard]] double median_depth(const State& state);

}  // namespace covey
