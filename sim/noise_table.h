// SPDX-License-Identifier: Apache-2.0
//
// Normal noise at the price of a table look-up: every row of an image reads the table from another
// random place, so that neither rows nor frames repeat visibly.
#pragma once

#include <cstdint>
#include <vector>

#include "sim/random.h"

namespace covey {

class NoiseTable {
 public:
  explicit NoiseTable(std::uint64_t seed) : random_(seed, 211), normals_(kSize + kLongestRow) {
    for (float& normal : normals_) normal = static_cast<float>(random_.gaussian());
  }

  // Standard normal numbers for a row of at most kLongestRow pixels.
  [[nodiscard]] const float* next_row() { return normals_.data() + random_.index(kSize); }

  static constexpr std::size_t kLongestRow = 16384;

 private:
  static constexpr std::size_t kSize = std::size_t{1} << 18;

  Random random_;
  std::vector<float> normals_;
};

}  // namespace covey
