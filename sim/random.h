// SPDX-License-Identifier: Apache-2.0
//
// Random numbers that are the same for one seed with every standard library: the distributions of
// <random> are not specified to the bit, the engine is. Nor is which argument of a call is
// evaluated first: of several draws each is a statement, or in a list in braces.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <random>

namespace covey {

class Random {
 public:
  // `stream` separates what is drawn for different purposes (or drones) from one seed.
  explicit Random(std::uint64_t seed, std::uint64_t stream = 0)
      : engine_(mix(seed + mix(stream + 1))) {}

  // Uniform in [0, 1).
  double unit() { return static_cast<double>(engine_() >> 11) * 0x1p-53; }
  double uniform(double low, double high) { return low + (high - low) * unit(); }

  // Uniform in [0, count), count > 0. The bias of the remainder is below 1e-12 here.
  std::size_t index(std::size_t count) { return static_cast<std::size_t>(engine_() % count); }

  // Standard normal, polar method (Marsaglia and Bray, 1964).
  double gaussian() {
    if (has_spare_) {
      has_spare_ = false;
      return spare_;
    }
    double a = 0, b = 0, radius2 = 0;
    do {
      a = uniform(-1, 1);
      b = uniform(-1, 1);
      radius2 = a * a + b * b;
    } while (radius2 >= 1 || radius2 == 0);
    const double scale = std::sqrt(-2 * std::log(radius2) / radius2);
    spare_ = b * scale;
    has_spare_ = true;
    return a * scale;
  }

  Eigen::Vector3d gaussian_vector() {
    const double x = gaussian(), y = gaussian(), z = gaussian();
    return {x, y, z};
  }

 private:
  // SplitMix64 (Steele et al., 2014): neighbouring seeds give unrelated engines.
  static std::uint64_t mix(std::uint64_t x) {
    x += 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
    return x ^ (x >> 31);
  }

  std::mt19937_64 engine_;
  double spare_ = 0;
  bool has_spare_ = false;
};

}  // namespace covey
