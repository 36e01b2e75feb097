// SPDX-License-Identifier: Apache-2.0
#include "frontend/compact_place.h"

#include <algorithm>
#include <cassert>
#include <cstring>

namespace covey {
namespace {

constexpr int kMaxDistanceBits = 20;  // of 64

std::vector<std::uint64_t> unpack(const std::vector<std::uint8_t>& place) {
  assert(place.size() % kCompactBytes == 0 && place.size() <= kCompactCorners * kCompactBytes);
  std::vector<std::uint64_t> corners(place.size() / kCompactBytes);
  if (!corners.empty()) std::memcpy(corners.data(), place.data(), place.size());
  return corners;
}

// Sums of bits side by side in ever wider fields. Unlike the processor's own instruction, which the
// oldest x86-64 lacks, this is inlined everywhere.
int bits_set(std::uint64_t v) {
  v -= (v >> 1) & 0x5555555555555555u;
  v = (v & 0x3333333333333333u) + ((v >> 2) & 0x3333333333333333u);
  v = (v + (v >> 4)) & 0x0f0f0f0f0f0f0f0fu;
  return static_cast<int>((v * 0x0101010101010101u) >> 56);
}

}  // namespace

std::vector<std::uint8_t> describe_compact(const std::vector<BinaryDescriptor>& features) {
  std::vector<std::uint8_t> place;
  const std::size_t corners = std::min(features.size(), kCompactCorners);
  for (std::size_t i = 0; i < corners; ++i) {
    place.insert(place.end(), features[i].begin(), features[i].begin() + kCompactBytes);
  }
  return place;
}

std::vector<IndexPair> common_corners(const std::vector<std::uint8_t>& a,
                                      const std::vector<std::uint8_t>& b) {
  const std::vector<std::uint64_t> corners_a = unpack(a), corners_b = unpack(b);
  MutualMatches matches(corners_a.size(), corners_b.size());
  for (std::size_t i = 0; i < corners_a.size(); ++i) {
    for (std::size_t j = 0; j < corners_b.size(); ++j) {
      matches.see(i, j, bits_set(corners_a[i] ^ corners_b[j]));
    }
  }
  return matches.pairs(kMaxDistanceBits, 1);
}

double corner_weight(const IndexPair& match) {
  return (1 - static_cast<double>(match.distance) / (kMaxDistanceBits + 1)) *
         (1 - static_cast<double>(match.distance) / match.second_distance);
}

double common_share(const std::vector<std::uint8_t>& a, const std::vector<std::uint8_t>& b) {
  const std::size_t corners = std::max(a.size(), b.size()) / kCompactBytes;
  if (corners == 0) return 0;
  double common = 0;
  for (const IndexPair& match : common_corners(a, b)) common += corner_weight(match);
  return common / static_cast<double>(corners);
}

}  // namespace covey
