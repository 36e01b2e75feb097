// SPDX-License-Identifier: Apache-2.0
//
// Which tracks become SLAM features: these should look in all directions.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "estimator/track_store.h"

namespace covey {

// In the order in which they should be taken: always from the part of the image that has the fewest
// features, those before it in the order counted, the track that was seen longest. `taken`:
// bearings of the features that there are. All bearings are those of the newest image.
[[nodiscard]] std::vector<const Track*> spread_over_image(
    const std::vector<const Track*>& tracks, const std::vector<Eigen::Vector2d>& taken);

}  // namespace covey
