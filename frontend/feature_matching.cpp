// SPDX-License-Identifier: Apache-2.0
#include "frontend/feature_matching.h"

#include <cstddef>

#include "frontend/place_recognition.h"

namespace covey {
namespace {

// Each own feature and each of the peer's landmarks that appears within the radius of it, with how
// far off, of the radius.
template <typename See>
void for_each_in_reach(const Eigen::Isometry3d& T_world_cam, const FrameOffset& offset,
                       const std::vector<OwnFeature>& own, const std::vector<PeerPoint>& peer,
                       const CameraIntrinsics& camera, double radius_px, const See& see) {
  std::vector<Eigen::Matrix2d> lens;
  lens.reserve(own.size());
  for (const OwnFeature& feature : own) lens.push_back(px_per_bearing(camera, feature.bearing));
  for (std::size_t j = 0; j < peer.size(); ++j) {
    const Eigen::Vector3d p_cam =
        T_world_cam.inverse() * to_own_world(offset, T_world_cam.translation(), peer[j].p_world);
    if (!(p_cam.z() > 1e-3)) continue;
    for (std::size_t i = 0; i < own.size(); ++i) {
      const double share = (lens[i] * (own[i].bearing - p_cam.hnormalized())).norm() / radius_px;
      if (share < 1) see(i, j, share);
    }
  }
}

constexpr double kAnyRatio = 2;  // place tells apart what nothing else can

}  // namespace

std::vector<IndexPair> match_descriptors(const std::vector<ShortDescriptor>& own,
                                         const std::vector<ShortDescriptor>& peer,
                                         const MatchingConfig& config) {
  MutualMatches matches(own.size(), peer.size());
  for (std::size_t i = 0; i < own.size(); ++i) {
    for (std::size_t j = 0; j < peer.size(); ++j) {
      matches.see(i, j, hamming_distance(own[i], peer[j]));
    }
  }
  return matches.pairs(config.max_distance_bits, config.ratio);
}

std::vector<IndexPair> match_guided(const Eigen::Isometry3d& T_world_cam, const FrameOffset& offset,
                                    const std::vector<OwnFeature>& own,
                                    const std::vector<PeerPoint>& peer,
                                    const CameraIntrinsics& camera, const GuidedConfig& config) {
  MutualMatches matches(own.size(), peer.size());
  for_each_in_reach(T_world_cam, offset, own, peer, camera, config.radius_px,
                    [&](std::size_t i, std::size_t j, double /*share*/) {
                      matches.see(i, j, hamming_distance(own[i].descriptor, peer[j].descriptor));
                    });
  return matches.pairs(config.max_distance_bits, kAnyRatio);
}

std::vector<IndexPair> match_nearest(const Eigen::Isometry3d& T_world_cam,
                                     const FrameOffset& offset, const std::vector<OwnFeature>& own,
                                     const std::vector<PeerPoint>& peer,
                                     const CameraIntrinsics& camera, const GuidedConfig& config) {
  constexpr int kRadius = 1 << 16;  // in which distances are counted
  MutualMatches matches(own.size(), peer.size());
  for_each_in_reach(T_world_cam, offset, own, peer, camera, config.radius_px,
                    [&](std::size_t i, std::size_t j, double share) {
                      matches.see(i, j, static_cast<int>(kRadius * share) + 1);
                    });
  return matches.pairs(kRadius, kAnyRatio);
}

}  // namespace covey
