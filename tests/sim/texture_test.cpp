// SPDX-License-Identifier: Apache-2.0
#include "sim/texture.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <opencv2/core.hpp>
#include <vector>

#include "sim/scene.h"

namespace covey {
namespace {

std::vector<double> profile(const Material& material, double length_m, double step_m, double v) {
  std::vector<double> values;
  const Footprint footprint{0.04f, 0.04f, 1, 0};
  const int count = static_cast<int>(length_m / step_m);
  values.reserve(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i)
    values.push_back(material_texture(
        material, {static_cast<float>(i * step_m), static_cast<float>(v)}, footprint));
  const double mean =
      std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  for (double& value : values) value -= mean;
  return values;
}

// Normalised autocorrelation over a few lines of the surface at one lag.
double autocorrelation(const std::vector<std::vector<double>>& lines, std::size_t lag) {
  double product = 0, power_a = 0, power_b = 0;
  for (const auto& line : lines)
    for (std::size_t i = 0; i + lag < line.size(); ++i) {
      product += line[i] * line[i + lag];
      power_a += line[i] * line[i];
      power_b += line[i + lag] * line[i + lag];
    }
  return product / std::sqrt(power_a * power_b);
}

TEST(Texture, GroundAndWallsDoNotRepeatWithinThirtyMetres) {
  constexpr double kStep = 0.05;  // m
  const Scene castle = make_castle({3, 4096});
  for (const Primitive& surface : castle.primitives) {
    const bool large = surface.shape == Shape::kGround ||
                       (surface.shape == Shape::kBox && surface.half.maxCoeff() > 10);
    if (!large) continue;
    const Material& material = castle.materials[static_cast<std::size_t>(surface.material)];
    std::vector<std::vector<double>> lines;
    lines.reserve(8);
    for (int k = 0; k < 8; ++k) lines.push_back(profile(material, 40, kStep, 1.7 * k));
    for (std::size_t lag = 40; lag <= 600; ++lag)
      ASSERT_LT(autocorrelation(lines, lag), 0.6)
          << "repeats after " << kStep * static_cast<double>(lag) << " m";
  }
}

Texture checkers(int size) {
  cv::Mat base(size, size, CV_8UC1);
  for (int y = 0; y < size; ++y)
    for (int x = 0; x < size; ++x) base.at<std::uint8_t>(y, x) = (x / 4 + y / 4) % 2 == 0 ? 0 : 255;
  return {base, 0.01f};
}

TEST(Texture, WideFootprintsSeeTheMeanAndNarrowOnesTheTexel) {
  const Texture texture = checkers(64);
  EXPECT_NEAR(texture.sample(0.02f, 0.02f, 0.002f), 0.0f, 0.01f);
  EXPECT_NEAR(texture.sample(0.06f, 0.02f, 0.002f), 1.0f, 0.01f);
  EXPECT_NEAR(texture.sample(0.06f, 0.02f, 0.3f), 0.5f, 0.02f);
}

TEST(Texture, LongFootprintsAverageAlongTheirMajorAxisOnly) {
  cv::Mat base(64, 64, CV_8UC1);
  for (int x = 0; x < 64; ++x) base.col(x).setTo(x % 8 < 4 ? 0 : 255);  // stripes along v
  const Texture stripes(base, 0.01f);
  const Footprint along_v{0.005f, 0.04f, 0, 1}, along_u{0.005f, 0.08f, 1, 0};
  EXPECT_NEAR(stripes.sample(0.06f, 0.1f, along_v), 1.0f, 0.05f);
  EXPECT_NEAR(stripes.sample(0.06f, 0.1f, along_u), 0.5f, 0.15f);
}

TEST(Texture, PeriodicBeyondItsEdges) {
  const Texture texture = checkers(64);
  constexpr float kPeriod_m = 0.64f;
  EXPECT_NEAR(texture.sample(0.123f, 0.456f, 0.01f),
              texture.sample(0.123f + kPeriod_m, 0.456f, 0.01f), 1e-4f);
  EXPECT_NEAR(texture.sample(-0.1f, -0.3f, 0.01f),
              texture.sample(-0.1f + kPeriod_m, -0.3f + kPeriod_m, 0.01f), 1e-4f);
}

}  // namespace
}  // namespace covey
