// SPDX-License-Identifier: Apache-2.0
//
// A place as the short forms of its corners: where two drones pick different corners of one scene,
// what they have in common is found corner by corner, and drowns in any sum over the whole image.
#pragma once

#include <cstddef>
#include <cstdint>
#include <tuple>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/mutual_matches.h"

namespace covey {

// 1200 bytes: the advert fits into one packet.
inline constexpr std::size_t kCompactCorners = 150;
inline constexpr std::size_t kCompactBytes = std::tuple_size_v<ShortDescriptor>;

// The first kCompactCorners descriptors, shortened, one after the other.
[[nodiscard]] std::vector<std::uint8_t> describe_compact(
    const std::vector<BinaryDescriptor>& features);

// Corners of two places that are each other's best match. Sizes must be multiples of kCompactBytes,
// at most kCompactCorners of them.
[[nodiscard]] std::vector<IndexPair> common_corners(const std::vector<std::uint8_t>& a,
                                                    const std::vector<std::uint8_t>& b);

// 1 for equal corners, falling to 0 as they differ, or as others are hardly worse. A limit for
// either would throw away most of what thermal images have in common, or let chance in.
[[nodiscard]] double corner_weight(const IndexPair& match);

// Share of corners, of the place that has more of them, that are each other's best match; each
// counts its weight.
[[nodiscard]] double common_share(const std::vector<std::uint8_t>& a,
                                  const std::vector<std::uint8_t>& b);

}  // namespace covey
