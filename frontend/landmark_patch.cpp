// SPDX-License-Identifier: Apache-2.0
#include "frontend/landmark_patch.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "frontend/patch_alignment.h"

namespace covey {
namespace {

constexpr int kSide = 8;   // samples of a patch
constexpr int kInner = 6;  // of those that have neighbours on all sides
constexpr int kArea = kInner * kInner;
constexpr float kLevels = 15;       // of grey
constexpr float kMinContrast = 12;  // grey levels of the image, brightest to darkest
constexpr int kMaxIterations = 12;
constexpr double kConverged_px = 0.02;
constexpr std::size_t kSamples = 64;  // of a patch, two in an octet
static_assert(2 * std::tuple_size_v<LandmarkPatch> == kSamples);
static_assert(kSamples / kSide == kSide);

using Samples = Eigen::Matrix<float, kSide, kSide>;
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

Samples decode(const LandmarkPatch& patch) {
  Samples samples;
  for (int i = 0; i < kSide * kSide; ++i) {
    const std::uint8_t two = patch[static_cast<std::size_t>(i / 2)];
    samples(i / kSide, i % kSide) = static_cast<float>(i % 2 == 0 ? two & 15 : two >> 4);
  }
  return samples;
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
};

std::optional<Fit> align(const Template& patch, const cv::Mat& image, PatchPlace grid,
                         double max_shift_px) {
  const Eigen::Vector2d start = grid.pixel;
  Fit fit;
  for (int i = 0; i < kMaxIterations; ++i) {
    if (!inside(image, grid, 0.5 * kInner)) return std::nullopt;
    const Eigen::Matrix<float, kInner, kInner> square = sample<kInner>(image, grid).transpose();
    Column grey = Eigen::Map<const Column>(square.data());
    grey.array() -= grey.mean();
    const float product = patch.grey.dot(grey);
    const float gain = product / patch.grey.squaredNorm();
    if (!(gain > 0)) return std::nullopt;
    fit = {grid.pixel, product / std::sqrt(patch.grey.squaredNorm() * grey.squaredNorm())};
    const Eigen::Vector2f step = patch.inverse_hessian * (patch.gradient.transpose() * grey) / gain;
    const Eigen::Vector2d moved = grid.affine * step.cast<double>();
    grid.pixel -= moved;
    if (!((grid.pixel - start).norm() < max_shift_px)) return std::nullopt;
    if (moved.norm() < kConverged_px) return fit;
  }
  return std::nullopt;
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
  const float darkest = samples.minCoeff(), contrast = samples.maxCoeff() - darkest;
  if (contrast < kMinContrast) return std::nullopt;
  LandmarkPatch patch{};
  for (int i = 0; i < kSide * kSide; ++i) {
    const float share = (samples(i / kSide, i % kSide) - darkest) / contrast;
    const auto level = static_cast<unsigned>(std::lround(kLevels * share));
    patch[static_cast<std::size_t>(i / 2)] |=
        static_cast<std::uint8_t>(i % 2 == 0 ? level : level << 4U);
  }
  return patch;
}

std::optional<Eigen::Vector2d> find_landmark_patch(const ImagePyramid& image,
                                                   const CameraIntrinsics& camera,
                                                   const SeenLandmark& seen,
                                                   const Eigen::Isometry3d& T_other_own,
                                                   const PatchSearchConfig& config) {
  const Eigen::Matrix3d R = T_other_own.linear().transpose();
  const Eigen::Vector3d q =
      R * (seen.bearing.homogeneous() - seen.inverse_depth * T_other_own.translation());
  constexpr double kMinDepth = 0.1, kMaxBearing = 2.0;
  if (!(q.z() > kMinDepth) || q.hnormalized().norm() > kMaxBearing) return std::nullopt;
  Eigen::Matrix2d J_pixel;
  PatchPlace grid;
  grid.pixel = project(camera, q.hnormalized(), &J_pixel);
  Eigen::Matrix<double, 2, 3> J_bearing;
  J_bearing << 1, 0, -q.x() / q.z(), 0, 1, -q.y() / q.z();
  grid.affine = J_pixel * J_bearing * R.leftCols<2>() * (seen.spacing / q.z());

  // Seen from nearer by, the samples lie far apart: a coarser image fits them.
  const double apart = std::sqrt(std::abs(grid.affine.determinant()));
  const int coarsest = static_cast<int>(image.levels.size()) - 1;
  const int level =
      std::clamp(static_cast<int>(std::lround(std::log2(apart / config.spacing_px))), 0, coarsest);
  const double scale = 1 << level;
  grid.pixel /= scale;
  grid.affine /= scale;
  const std::optional<Template> patch = template_of(*seen.patch);
  if (!patch) return std::nullopt;
  const auto fit = align(*patch, image.levels[static_cast<std::size_t>(level)], grid,
                         config.max_shift_px / scale);
  if (!fit || fit->correlation < config.min_correlation) return std::nullopt;
  return unproject(camera, fit->pixel * scale);
}

}  // namespace covey
