// SPDX-License-Identifier: Apache-2.0
#include "apps/flight_counts.h"

#include <nlohmann/json.hpp>

namespace covey {

void FlightCounts::add(const ImageResult& result) {
  ++frames;
  track_sightings += result.timing.tracks;
  tracks_begun += result.tracks_begun;
  const UpdateReport& update = result.update;
  filter.msckf_used += update.msckf_used;
  filter.msckf_gated += update.msckf_gated;
  filter.slam_used += update.slam_used;
  filter.slam_gated += update.slam_gated;
  filter.slam_initialized += update.slam_initialized;
  filter.imu_gaps += update.imu_gaps;
  filter.imu_rejected += update.imu_rejected;
  filter.out_of_order += update.out_of_order;
  filter.images_refused += update.images_refused;
  filter.failed_updates += update.failed_updates;
  zero_velocity_images += update.zero_velocity ? 1 : 0;
  reinitialized += update.reinitialized ? 1 : 0;
  if (result.content == ImageContent::kScene) return;
  ++(result.content == ImageContent::kUniform ? uniform_images : repeated_images);
}

nlohmann::json filter_json(const FlightCounts& counts) {
  const UpdateReport& filter = counts.filter;
  return {{"msckf_used", filter.msckf_used},
          {"msckf_gated", filter.msckf_gated},
          {"slam_used", filter.slam_used},
          {"slam_gated", filter.slam_gated},
          {"slam_initialized", filter.slam_initialized},
          {"zero_velocity_images", counts.zero_velocity_images},
          {"imu_gaps", filter.imu_gaps},
          {"imu_rejected", filter.imu_rejected},
          {"out_of_order", filter.out_of_order},
          {"images_refused", filter.images_refused},
          {"failed_updates", filter.failed_updates},
          {"reinitialized", counts.reinitialized},
          {"repeated_images", counts.repeated_images},
          {"uniform_images", counts.uniform_images}};
}

}  // namespace covey
