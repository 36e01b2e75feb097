// SPDX-License-Identifier: Apache-2.0
#include "apps/start_doubt.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "estimator/so3.h"

namespace covey {
namespace {

int not_found(const CollaboratorReport& collaboration) {
  int sum = 0;
  for (const NoMatchReason reason : {NoMatchReason::kTooFewMatches, NoMatchReason::kTooFewInliers,
                                     NoMatchReason::kOffsetTooLarge}) {
    sum += collaboration.no_match[static_cast<std::size_t>(reason)];
  }
  return sum;
}

}  // namespace

std::optional<std::string> doubt_of_start(const PeerCounts& counts,
                                          const CollaboratorReport& collaboration) {
  constexpr int kFewestMisfits = 8, kMisfitsPerFit = 10;
  const std::int64_t misfits = counts.gated + not_found(collaboration);
  if (misfits < kFewestMisfits || misfits < kMisfitsPerFit * counts.fused) return std::nullopt;
  return fmt::format(
      "{} of {} answers of other drones fit: has each started where it says (initialisation: x_m, "
      "y_m, z_m, yaw_deg, or its ground truth)? With fusion.common_start false, or covey team "
      "--unknown-start, they find each other wherever they start",
      counts.fused, counts.fused + misfits);
}

std::string words_on_move(const std::string& peer, const DriftFilter& team) {
  const std::optional<WorldAlignment> world = team.alignment_at_start(peer);
  std::string words = peer + "'s world lies elsewhere than was believed: common places have it";
  if (!world) return words + " where nothing more is known of it";
  const Eigen::Vector3d p = world->T_own_peer * world->p_peer - world->p_peer;
  return fmt::format("{} {:.2f} m and {:.1f} degrees from the own one", words, p.norm(),
                     std::abs(nearest_yaw(world->T_own_peer.linear())) * 180 / M_PI);
}

}  // namespace covey
