// SPDX-License-Identifier: Apache-2.0
//
// The filter's state as the paper's messages carry it.
#pragma once

#include "estimator/filter_snapshot.h"
#include "estimator/state.h"

namespace covey {

// Without the intrinsics, which the paper does not estimate.
[[nodiscard]] FilterSnapshot snapshot_of(const State& state);

}  // namespace covey
