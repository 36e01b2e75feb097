// SPDX-License-Identifier: Apache-2.0
#include "frontend/landmark_patch.h"

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "frontend/patch_alignment.h"

namespace covey {
namespace {

constexpr int kSide = 8;   // samples of a patch
constexpr int kInner = 6;  // of those that have neighbours on all sides
constexpr int kArea = kInner * kInner;
constexpr float kContrast = 15;     // of a decoded patch, brightest to darkest
constexpr float kMinContrast = 12;  // grey levels of the image, brightest to darkest
constexpr int kMaxIterations = 12;
constexpr double kConverged_px = 0.02;
constexpr std::size_t kCoefficients = 2 * std::tuple_size_v<LandmarkPatch>;
constexpr float kLargest = 7;  // of a coefficient, 4 bits with a sign

using Samples = Eigen::Matrix<float, kSide, kSide, Eigen::RowMajor>;
using Column = Eigen::Matrix<float, kArea, 1>;
using Gradient = Eigen::Matrix<float, kArea, 2>;

float bilinear(const cv::Mat& image, const Eigen::Vector2d& pixel) {
  const int x = static_cast<int>(pixel.x()), y = static_cast<int>(pixel.y());
  const auto fx = static_cast<float>(pixel.x() - x), fy = static_cast<float>(pixel.y() - y);
  const std::uint8_t* top = image.ptr<std::uint8_t>(y) + x;
  const std::uint8_t* bottom = image.ptr<std::uint8_t>(y + 1) + x;
  const auto between = [](float a, float b, float f) { return a + f * (b - a); };
  return between(between(top[0], top[1], fx), between(bottom[0], bottom[1], fx), fy);
}

template <int Side>
Eigen::Matrix<float, Side, Side> sample(const cv::Mat& image, const PatchPlace& grid) {
  Eigen::Matrix<float, Side, Side> samples;
  constexpr double kMiddle = (Side - 1) / 2.0;
  for (int row = 0; row < Side; ++row) {
    for (int column = 0; column < Side; ++column) {
      const Eigen::Vector2d at(column - kMiddle, row - kMiddle);
      samples(row, column) = bilinear(image, grid.pixel + grid.affine * at);
    }
  }
  return samples;
}

struct Wave {
  int vertical = 0, horizontal = 0;  // half periods in the patch
};

// The longest waves, without the mean: what aligns a patch best is in them.
std::array<Wave, kCoefficients> longest_waves() {
  std::vector<Wave> waves;
  for (int i = 1; i < kSide * kSide; ++i) waves.push_back({i / kSide, i % kSide});
  const auto length = [](const Wave& w) {
    return w.vertical * w.vertical + w.horizontal * w.horizontal;
  };
  std::stable_sort(waves.begin(), waves.end(),
                   [&](const Wave& a, const Wave& b) { return length(a) < length(b); });
  std::array<Wave, kCoefficients> longest{};
  std::copy_n(waves.begin(), longest.size(), longest.begin());
  return longest;
}

const std::array<Wave, kCoefficients>& waves() {
  static const std::array<Wave, kCoefficients> longest = longest_waves();
  return longest;
}

LandmarkPatch encode(const Samples& samples) {
  cv::Matx<float, kSide, kSide> spectrum;
  cv::dct(cv::Matx<float, kSide, kSide>(samples.data()), spectrum);
  float largest = 0;
  for (const Wave& w : waves()) {
    largest = std::max(largest, std::abs(spectrum(w.vertical, w.horizontal)));
  }
  LandmarkPatch patch{};
  if (!(largest > 0)) return patch;
  for (std::size_t i = 0; i < kCoefficients; ++i) {
    const Wave w = waves()[i];
    const auto level = std::lround(kLargest / largest * spectrum(w.vertical, w.horizontal));
    const unsigned nibble = static_cast<unsigned>(level) & 15U;
    patch[i / 2] |= static_cast<std::uint8_t>(i % 2 == 0 ? nibble : nibble << 4U);
  }
  return patch;
}

// Gain and offset are lost; the contrast is kContrast.
Samples decode(const LandmarkPatch& patch) {
  cv::Matx<float, kSide, kSide> spectrum, grey;
  for (std::size_t i = 0; i < kCoefficients; ++i) {
    const int nibble = i % 2 == 0 ? patch[i / 2] & 15 : patch[i / 2] >> 4;
    const Wave w = waves()[i];
    spectrum(w.vertical, w.horizontal) = static_cast<float>(nibble < 8 ? nibble : nibble - 16);
  }
  cv::idct(spectrum, grey);
  const Eigen::Map<const Samples> samples(grey.val);
  const float contrast = samples.maxCoeff() - samples.minCoeff();
  return contrast > 0 ? Samples(samples * (kContrast / contrast)) : Samples::Zero();
}

// What the steps of an alignment need of a patch: zero-mean grey and steepest descent, blind to
// gain and offset.
struct Template {
  Column grey;
  Gradient gradient;  // grey levels per sample
  Eigen::Matrix2f inverse_hessian;
};

std::optional<Template> template_of(const LandmarkPatch& patch) {
  const Samples samples = decode(patch);
  Template result;
  for (int row = 0, i = 0; row < kInner; ++row) {
    for (int column = 0; column < kInner; ++column, ++i) {
      result.grey(i) = samples(row + 1, column + 1);
      result.gradient(i, 0) = (samples(row + 1, column + 2) - samples(row + 1, column)) / 2;
      result.gradient(i, 1) = (samples(row + 2, column + 1) - samples(row, column + 1)) / 2;
    }
  }
  result.grey.array() -= result.grey.mean();
  const float energy = result.grey.squaredNorm();
  if (!(energy > 0)) return std::nullopt;
  result.gradient.rowwise() -= result.gradient.colwise().mean().eval();
  result.gradient -= result.grey * (result.grey.transpose() * result.gradient / energy).eval();
  const Eigen::Matrix2f hessian = result.gradient.transpose() * result.gradient;
  constexpr float kMinDeterminant = 1.0F;  // an edge or nothing cannot be found
  if (!(hessian.determinant() > kMinDeterminant)) return std::nullopt;
  result.inverse_hessian = hessian.inverse();
  return result;
}

struct Fit {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  double correlation = 0;
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  // px^2
};

// Of the place, px^2: two of the samples are spent on gain and offset, two on the place.
Eigen::Matrix2d covariance_of(const Template& patch, const Eigen::Matrix2d& affine,
                              double correlation) {
  const double unlike = std::max(0.0, 1 - correlation * correlation);
  const double rest = patch.grey.squaredNorm() * unlike / (kArea - 4);
  return rest * affine * patch.inverse_hessian.cast<double>() * affine.transpose();
}

std::optional<Fit> align(const Template& patch, const cv::Mat& image, PatchPlace grid,
                         double max_shift_px) {
  const Eigen::Vector2d start = grid.pixel;
  for (int i = 0; i < kMaxIterations; ++i) {
    if (!inside(image, grid, 0.5 * kInner)) return std::nullopt;
    const Eigen::Matrix<float, kInner, kInner> square = sample<kInner>(image, grid).transpose();
    Column grey = Eigen::Map<const Column>(square.data());
    grey.array() -= grey.mean();
    const float product = patch.grey.dot(grey);
    const float gain = product / patch.grey.squaredNorm();
    if (!(gain > 0)) return std::nullopt;
    const double correlation = product / std::sqrt(patch.grey.squaredNorm() * grey.squaredNorm());
    const Eigen::Vector2d pixel = grid.pixel;
    const Eigen::Vector2f step = patch.inverse_hessian * (patch.gradient.transpose() * grey) / gain;
    const Eigen::Vector2d moved = grid.affine * step.cast<double>();
    grid.pixel -= moved;
    if (!((grid.pixel - start).norm() < max_shift_px)) return std::nullopt;
    if (moved.norm() < kConverged_px) {
      return Fit{pixel, correlation, covariance_of(patch, grid.affine, correlation)};
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
  constexpr double kMinDepth = 0.1, kMaxBearing = 2.0;
  Sight sight;
  sight.p_own = T_own_other.linear() * seen.bearing.homogeneous() +
                seen.inverse_depth * T_own_other.translation();
  if (!(sight.p_own.z() > kMinDepth) || sight.p_own.hnormalized().norm() > kMaxBearing) {
    return std::nullopt;
  }
  const Eigen::Vector2d bearing = sight.p_own.hnormalized();
  sight.pixel = project(camera, bearing, &sight.J_bearing);
  Eigen::Matrix<double, 2, 3> J_bearing_p;
  J_bearing_p << 1, 0, -bearing.x(), 0, 1, -bearing.y();
  sight.J_p = sight.J_bearing * J_bearing_p;
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

// Aligned on the level whose pixels lie about as far apart as the samples; in px of the image
// itself.
std::optional<Fit> find(const Template& patch, const ImagePyramid& image, PatchPlace place,
                        const PatchSearchConfig& config) {
  // Seen from nearer by, the samples lie far apart: a coarser image fits them.
  const double apart = std::sqrt(std::abs(place.affine.determinant()));
  const int coarsest = static_cast<int>(image.levels.size()) - 1;
  const int level =
      std::clamp(static_cast<int>(std::lround(std::log2(apart / config.spacing_px))), 0, coarsest);
  const double scale = 1 << level;
  place.pixel /= scale;
  place.affine /= scale;
  std::optional<Fit> fit = align(patch, image.levels[static_cast<std::size_t>(level)], place,
                                 config.max_shift_px / scale);
  if (!fit || fit->correlation < config.min_correlation) return std::nullopt;
  fit->pixel *= scale;
  fit->covariance *= scale * scale;
  return fit;
}

}  // namespace

std::optional<LandmarkPatch> cut_landmark_patch(const cv::Mat& image,
                                                const CameraIntrinsics& camera,
                                                const Eigen::Vector2d& bearing, double spacing) {
  PatchPlace grid;  // one sample apart: one px of the patch
  grid.pixel = project(camera, bearing, &grid.affine);
  grid.affine *= spacing;
  if (!inside(image, grid, 0.5 * kSide)) return std::nullopt;
  const Samples samples = sample<kSide>(image, grid);
  if (samples.maxCoeff() - samples.minCoeff() < kMinContrast) return std::nullopt;
  return encode(samples);
}

std::optional<FoundPatch> find_landmark_patch(const ImagePyramid& image,
                                              const CameraIntrinsics& camera,
                                              const SeenLandmark& seen,
                                              const Eigen::Isometry3d& T_other_own,
                                              const PatchSearchConfig& config) {
  const Eigen::Isometry3d T_own_other = T_other_own.inverse();
  const std::optional<Sight> sight = sight_of(seen, T_own_other, camera);
  if (!sight) return std::nullopt;
  const std::optional<Template> patch = template_of(*seen.patch);
  if (!patch) return std::nullopt;
  std::optional<Fit> best;
  for (const Eigen::Vector3d& normal : surfaces_of(seen)) {
    const std::optional<PatchPlace> place = place_on(seen, *sight, T_own_other, normal);
    if (!place) continue;
    const std::optional<Fit> fit = find(*patch, image, *place, config);
    if (fit && (!best || fit->correlation > best->correlation)) best = fit;
  }
  if (!best) return std::nullopt;
  const std::optional<Eigen::Vector2d> bearing = unproject(camera, best->pixel);
  if (!bearing) return std::nullopt;
  const Eigen::Matrix2d to_bearing = sight->J_bearing.inverse();
  return FoundPatch{*bearing, to_bearing * best->covariance * to_bearing.transpose()};
}

}  // namespace covey
