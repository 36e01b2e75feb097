// SPDX-License-Identifier: Apache-2.0
//
// What a drone's own summary says of its flight beyond the team's figures: where the worlds were
// found to lie, what was found of the camera, and why peers' messages came to nothing.
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "apps/pipeline.h"
#include "comms/link.h"
#include "estimator/drift_filter.h"

namespace covey {

// Of a frame that stands upright: position_m, yaw_deg.
[[nodiscard]] nlohmann::json level_frame_json(const Eigen::Isometry3d& frame);

// Peers' worlds in the own one, those that have been found.
[[nodiscard]] nlohmann::json peer_worlds_json(const DriftFilter& team);

// As found in flight, and what it began with.
[[nodiscard]] nlohmann::json camera_json(const Pipeline& pipeline);

// For those who tune the exchange. `learned`: keyframes of peers that told something.
[[nodiscard]] nlohmann::json exchange_json(const Pipeline& pipeline,
                                           const LinkStatistics& statistics, std::int64_t learned);

}  // namespace covey
