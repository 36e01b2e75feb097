// SPDX-License-Identifier: Apache-2.0
#include "frontend/landmark_patch.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <tuple>
#include <utility>
#include <vector>

#include "estimator/bearing.h"
#include "frontend/patch_alignment.h"

namespace covey {
namespace {

constexpr int kSide = 8;                      // samples of a patch
constexpr double kReach = 0.5 * (kSide + 2);  // samples, of a search: it looks at gradients too
constexpr int kWaves = 12;                    // of which it is made
constexpr int kLongest = 4;                   // of them, that have a bit more
constexpr float kMinContrast = 12;            // grey levels of the image, brightest to darkest
constexpr int kMaxIterations = 12;
constexpr double kConverged_px = 0.02;

using Samples = Eigen::Matrix<float, kSide, kSide, Eigen::RowMajor>;
using Waves = Eigen::Matrix<float, kWaves, 1>;
using Gradient = Eigen::Matrix<float, kWaves, 2>;
using Basis = Eigen::Matrix<float, kWaves, kSide * kSide>;

float bilinear(const cv::Mat& image, float across, float down) {
  const int x = static_cast<int>(across), y = static_cast<int>(down);
  const float fx = across - static_cast<float>(x), fy = down - static_cast<float>(y);
  const std::uint8_t* top = image.data + static_cast<std::size_t>(y) * image.step[0] + x;
  const std::uint8_t* bottom = top + image.step[0];
  const auto between = [](float a, float b, float f) { return a + f * (b - a); };
  return between(between(top[0], top[1], fx), between(bottom[0], bottom[1], fx), fy);
}

template <int Side>
Eigen::Matrix<float, Side, Side, Eigen::RowMajor> sample(const cv::Mat& image,
                                                         const PatchPlace& grid) {
  Eigen::Matrix<float, Side, Side, Eigen::RowMajor> samples;
  constexpr double kMiddle = (Side - 1) / 2.0;
  const Eigen::Vector2f first =
      (grid.pixel - kMiddle * (grid.affine.col(0) + grid.affine.col(1))).cast<float>();
  const Eigen::Matrix2f step = grid.affine.cast<float>();
  for (int row = 0; row < Side; ++row) {
    const Eigen::Vector2f begin = first + static_cast<float>(row) * step.col(1);
    for (int column = 0; column < Side; ++column) {
      const Eigen::Vector2f at = begin + static_cast<float>(column) * step.col(0);
      samples(row, column) = bilinear(image, at.x(), at.y());
    }
  }
  return samples;
}

// The longest waves of the cosine transform (DCT-II), without the mean. The shorter a wave is, the
// more it tells of the place, and the weaker it is in images: the square root of its frequency
// makes up for that, so that rounding costs all of them about as much.
Basis longest_waves() {
  std::vector<std::pair<int, int>> periods;  // halves of them in the patch, downwards and across
  for (int i = 1; i < kSide * kSide; ++i) periods.emplace_back(i / kSide, i % kSide);
  const auto frequency = [](const std::pair<int, int>& p) { return std::hypot(p.first, p.second); };
  std::stable_sort(periods.begin(), periods.end(),
                   [&](const auto& a, const auto& b) { return frequency(a) < frequency(b); });
  const auto cosine = [](int halves, int at) {
    return std::sqrt((halves > 0 ? 2.0 : 1.0) / kSide) *
           std::cos(M_PI * halves * (at + 0.5) / kSide);
  };
  Basis basis;
  for (int k = 0; k < kWaves; ++k) {
    const auto& [down, across] = periods[static_cast<std::size_t>(k)];
    const double weight = std::sqrt(frequency({down, across}));
    for (int i = 0; i < kSide * kSide; ++i) {
      basis(k, i) =
          static_cast<float>(weight * cosine(down, i / kSide) * cosine(across, i % kSide));
    }
  }
  return basis;
}

Waves waves_of(const Samples& samples) {
  static const Basis basis = longest_waves();
  return basis * Eigen::Map<const Eigen::Matrix<float, kSide * kSide, 1>>(samples.data());
}

// Levels lie one after the other, the low bits of each in the lower octet. The longest waves are
// the strongest, as a rule twice as strong as any other: with a bit more all have one unit, which
// is as small as that of six bits each.
struct Bits {
  std::size_t octet = 0;
  unsigned shift = 0, count = 0;
  [[nodiscard]] unsigned mask() const { return (1U << count) - 1; }
  [[nodiscard]] int largest() const { return (1 << (count - 1)) - 1; }
  [[nodiscard]] bool ends_in_next() const { return shift + count > 8; }
};

Bits bits_of(int wave) {
  constexpr int kFewest = 5;
  static_assert(kFewest * kWaves + kLongest == 8 * std::tuple_size_v<LandmarkPatch>);
  const auto first = static_cast<unsigned>(kFewest * wave + std::min(wave, kLongest));
  return {first / 8, first % 8, wave < kLongest ? kFewest + 1U : kFewest};
}

LandmarkPatch encode(const Waves& waves) {
  float unit = 0;
  for (int k = 0; k < kWaves; ++k) {
    unit = std::max(unit, std::abs(waves(k)) / static_cast<float>(bits_of(k).largest()));
  }
  LandmarkPatch patch{};
  if (!(unit > 0)) return patch;
  for (int k = 0; k < kWaves; ++k) {
    const auto level = std::lround(waves(k) / unit);
    const Bits at = bits_of(k);
    const unsigned bits = (static_cast<unsigned>(level) & at.mask()) << at.shift;
    patch[at.octet] |= static_cast<std::uint8_t>(bits);
    if (at.ends_in_next()) patch[at.octet + 1] |= static_cast<std::uint8_t>(bits >> 8U);
  }
  return patch;
}

// Gain and offset are lost: of unit length. Nothing if there is nothing to see.
std::optional<Waves> decode(const LandmarkPatch& patch) {
  Waves waves;
  for (int k = 0; k < kWaves; ++k) {
    const Bits at = bits_of(k);
    unsigned bits = patch[at.octet];
    if (at.ends_in_next()) bits |= static_cast<unsigned>(patch[at.octet + 1]) << 8U;
    const auto level = static_cast<int>((bits >> at.shift) & at.mask());
    waves(k) = static_cast<float>(level <= at.largest() ? level : level - 2 * (at.largest() + 1));
  }
  if (waves.isZero()) return std::nullopt;
  return waves.normalized();
}

// What an image shows at a place, and how that changes as the place moves, per sample.
struct Look {
  Waves waves;
  Gradient gradient;
};

Look look_at(const cv::Mat& image, const PatchPlace& grid) {
  const auto wide = sample<kSide + 2>(image, grid);
  const auto shifted = [&wide](int down, int across) {
    return wide.block<kSide, kSide>(1 + down, 1 + across);
  };
  Look look;
  look.waves = waves_of(shifted(0, 0));
  look.gradient.col(0) = waves_of((shifted(0, 1) - shifted(0, -1)) / 2);
  look.gradient.col(1) = waves_of((shifted(1, 0) - shifted(-1, 0)) / 2);
  return look;
}

// How the waves change with the place, but for what another gain would do to them.
struct Slope {
  Gradient gradient;
  Eigen::Matrix2d inverse_hessian = Eigen::Matrix2d::Zero();
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();  // where it was taken
};

std::optional<Slope> slope_of(const Waves& patch, const Look& look, const Eigen::Vector2d& pixel) {
  constexpr float kMinTexture = 2e-3F;  // an edge or nothing cannot be found
  Slope slope;
  slope.gradient = look.gradient - patch * (patch.transpose() * look.gradient).eval();
  const Eigen::Matrix2f hessian = slope.gradient.transpose() * slope.gradient;
  const float energy = look.waves.squaredNorm();
  if (!(std::sqrt(hessian.determinant()) > kMinTexture * energy)) return std::nullopt;
  slope.inverse_hessian = hessian.inverse().cast<double>();
  slope.pixel = pixel;
  return slope;
}

struct Fit {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double correlation = 0;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // px^2
};

// How far from where it is expected something may be found, px of one level.
struct Reach {
  Eigen::Vector2d expected = Eigen::Vector2d::Zero();
  double max_shift = 0;
};

// Only in the waves that were sent: of the others nothing is known, and they would pull at those.
// What the patch would look like with another gain is taken out of both sides.
std::optional<Fit> align(const Waves& patch, const cv::Mat& image, PatchPlace grid,
                         const Reach& reach) {
  constexpr double kSameSlope_px = 0.2;  // nearer than that the slope is as good as the same
  constexpr int kSpent = 3;              // waves, on gain and place
  std::optional<Slope> slope;
  for (int i = 0; i < kMaxIterations; ++i) {
    if (!inside(image, grid, kReach)) return std::nullopt;
    Waves waves;
    if (slope && (grid.pixel - slope->pixel).norm() < kSameSlope_px) {
      waves = waves_of(sample<kSide>(image, grid));
    } else {
      const Look look = look_at(image, grid);
      slope = slope_of(patch, look, grid.pixel);
      if (!slope) return std::nullopt;
      waves = look.waves;
    }
    const float energy = waves.squaredNorm(), product = patch.dot(waves);
    if (!(product > 0)) return std::nullopt;
    waves -= product * patch;
    const Eigen::Vector2d step =
        -slope->inverse_hessian * (slope->gradient.transpose() * waves).cast<double>();
    const Eigen::Vector2d pixel = grid.pixel, moved = grid.affine * step;
    grid.pixel += moved;
    if (!((grid.pixel - reach.expected).norm() < reach.max_shift)) return std::nullopt;
    if (moved.norm() < kConverged_px) {
      const double rest = waves.squaredNorm() / (kWaves - kSpent);
      return Fit{pixel, product / std::sqrt(energy),
                 rest * grid.affine * slope->inverse_hessian * grid.affine.transpose()};
    }
  }
  return std::nullopt;
}

// A landmark as the own camera would see it.
struct Sight {
  Eigen::Vector3d p_own = Eigen::Vector3d::Zero();  // over its depth in the other camera
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d J_bearing = Eigen::Matrix2d::Zero();  // of the pixel by the own bearing
  Eigen::Matrix<double, 2, 3> J_p;                      // by p_own, times its depth
};

std::optional<Sight> sight_of(const SeenLandmark& seen, const Eigen::Isometry3d& T_own_other,
                              const CameraIntrinsics& camera) {
  constexpr double kMinDepth = 0.1;
  Sight sight;
  sight.p_own = T_own_other.linear() * seen.bearing.homogeneous() +
                seen.inverse_depth * T_own_other.translation();
  if (!(sight.p_own.z() > kMinDepth)) return std::nullopt;
  const Eigen::Vector2d bearing = sight.p_own.hnormalized();
  if (!is_on_lens(camera, bearing)) return std::nullopt;
  sight.pixel = project(camera, bearing, &sight.J_bearing);
  sight.J_p = sight.J_bearing * bearing_by_point_at_depth_1(bearing);
  return sight;
}

// Normals, in the other camera, of what a landmark may be part of: a plane that faces that camera,
// level ground, or an upright wall that is seen from one side or the other.
std::array<Eigen::Vector3d, 4> surfaces_of(const SeenLandmark& seen) {
  constexpr double kAside = 0.8;  // rad
  const Eigen::Vector3d b = seen.bearing.homogeneous();
  const Eigen::Vector3d straight = std::cos(kAside) * (b - b.dot(seen.up) * seen.up).normalized();
  const Eigen::Vector3d aside = std::tan(kAside) * seen.up.cross(straight);
  return {Eigen::Vector3d::UnitZ(), seen.up, straight + aside, straight - aside};
}

// Where the patch lies if its surface is a plane with this normal, of unit length. Nothing where
// that is seen along the plane.
std::optional<PatchPlace> place_on(const SeenLandmark& seen, const Sight& sight,
                                   const Eigen::Isometry3d& T_own_other,
                                   const Eigen::Vector3d& normal) {
  constexpr double kGrazing = 0.05;  // sine of the angle
  const Eigen::Vector3d b = seen.bearing.homogeneous();
  const double facing = normal.dot(b);
  if (!(std::abs(facing) > kGrazing * b.norm())) return std::nullopt;
  // On the plane the inverse depth grows as normal.dot(bearing) does.
  const Eigen::Matrix<double, 3, 2> J_p =
      T_own_other.linear().leftCols<2>() +
      seen.inverse_depth / facing * T_own_other.translation() * normal.head<2>().transpose();
  PatchPlace place;
  place.pixel = sight.pixel;
  place.affine = sight.J_p * J_p * (seen.spacing / sight.p_own.z());
  return place;
}

// Aligned on the level whose pixels lie about as far apart as the samples, from where another
// surface was found `before`, if one was; in px of the image itself.
std::optional<Fit> find(const Waves& patch, const ImagePyramid& image, PatchPlace place,
                        const std::optional<Fit>& before, const PatchSearchConfig& config) {
  // Seen from nearer by, the samples lie far apart: a coarser image fits them.
  const double apart = std::sqrt(std::abs(place.affine.determinant()));
  const int coarsest = static_cast<int>(image.levels.size()) - 1;
  const int level =
      std::clamp(static_cast<int>(std::lround(std::log2(apart / config.spacing_px))), 0, coarsest);
  const double scale = 1 << level;
  const Reach reach{place.pixel / scale, config.max_shift_px / scale};
  place.pixel = (before ? before->pixel : place.pixel) / scale;
  place.affine /= scale;
  std::optional<Fit> fit =
      align(patch, image.levels[static_cast<std::size_t>(level)], place, reach);
  if (!fit || fit->correlation < config.min_correlation) return std::nullopt;
  fit->pixel *= scale;
  fit->covariance *= scale * scale;
  return fit;
}

}  // namespace

double reach_px(const PatchSearchConfig& config) { return kReach * config.spacing_px; }

std::optional<LandmarkPatch> cut_landmark_patch(const cv::Mat& image,
                                                const CameraIntrinsics& camera,
                                                const Eigen::Vector2d& bearing, double spacing) {
  PatchPlace grid;  // one sample apart: one px of the patch
  grid.pixel = project(camera, bearing, &grid.affine);
  grid.affine *= spacing;
  if (!inside(image, grid, 0.5 * kSide)) return std::nullopt;
  const Samples samples = sample<kSide>(image, grid);
  if (samples.maxCoeff() - samples.minCoeff() < kMinContrast) return std::nullopt;
  return encode(waves_of(samples));
}

std::optional<FoundPatch> find_landmark_patch(const ImagePyramid& image,
                                              const CameraIntrinsics& camera,
                                              const SeenLandmark& seen,
                                              const Eigen::Isometry3d& T_other_own,
                                              const PatchSearchConfig& config) {
  const Eigen::Isometry3d T_own_other = T_other_own.inverse();
  const std::optional<Sight> sight = sight_of(seen, T_own_other, camera);
  if (!sight) return std::nullopt;
  const std::optional<Waves> patch = decode(*seen.patch);
  if (!patch) return std::nullopt;
  std::optional<Fit> best;
  for (const Eigen::Vector3d& normal : surfaces_of(seen)) {
    const std::optional<PatchPlace> place = place_on(seen, *sight, T_own_other, normal);
    if (!place) continue;
    const std::optional<Fit> fit = find(*patch, image, *place, best, config);
    if (fit && (!best || fit->correlation > best->correlation)) best = fit;
  }
  if (!best) return std::nullopt;
  const std::optional<Eigen::Vector2d> bearing = unproject(camera, best->pixel);
  if (!bearing) return std::nullopt;
  const Eigen::Matrix2d to_bearing = sight->J_bearing.inverse();
  return FoundPatch{*bearing, to_bearing * best->covariance * to_bearing.transpose()};
}

}  // namespace covey
