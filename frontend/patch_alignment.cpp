// SPDX-License-Identifier: Apache-2.0
#include "frontend/patch_alignment.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace covey {
namespace {

constexpr int kSide = Patch::kSide;
constexpr int kArea = kSide * kSide;
constexpr int kRadius = kSide / 2;
constexpr float kMinGain = 0.1f;  // an image ten times flatter than the patch holds no patch

using Column = Eigen::Matrix<float, kArea, 1>;
using Gradient = Eigen::Matrix<float, kArea, 2>;
using AffineImages = Eigen::Matrix<float, kArea, 4>;
using Matrix6f = Eigen::Matrix<float, 6, 6>;
using Vector6f = Eigen::Matrix<float, 6, 1>;

// Bilinear, in fixed point: 16 bits of fraction for places, 11 for weights.
template <int Side>
void sample(const cv::Mat& image, const PatchPlace& place, float* out) {
  const auto fixed = [](double x) { return static_cast<int>(std::floor(x * 65536 + 0.5)); };
  constexpr int kHalf = Side / 2;
  const Eigen::Vector2d corner = place.pixel - place.affine * Eigen::Vector2d::Constant(kHalf);
  const int du = fixed(place.affine(0, 0)), dv = fixed(place.affine(1, 0));
  const auto step = static_cast<std::ptrdiff_t>(image.step);
  for (int row = 0; row < Side; ++row) {
    int u = fixed(corner.x() + row * place.affine(0, 1));
    int v = fixed(corner.y() + row * place.affine(1, 1));
    for (int column = 0; column < Side; ++column, u += du, v += dv) {
      const std::uint8_t* top = image.data + (v >> 16) * step + (u >> 16);
      const std::uint8_t* bottom = top + step;
      const int fu = (u & 0xffff) >> 5, fv = (v & 0xffff) >> 5;
      const int above = (top[0] << 11) + fu * (top[1] - top[0]);
      const int below = (bottom[0] << 11) + fu * (bottom[1] - bottom[0]);
      const int blended = (above << 1) + ((fv * ((below - above) >> 3)) >> 7);
      *out++ = static_cast<float>(blended) * (1.0f / 4096);
    }
  }
}

struct PatchImages {
  Column grey;        // zero-mean
  Gradient gradient;  // grey levels/px
};

PatchImages cut_images(const cv::Mat& image, const PatchPlace& place) {
  constexpr int kWide = kSide + 2;
  Eigen::Matrix<float, kWide, kWide, Eigen::RowMajor> wide;
  sample<kWide>(image, place, wide.data());
  PatchImages images;
  for (int y = 0, i = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x, ++i) {
      images.grey(i) = wide(y + 1, x + 1);
      images.gradient(i, 0) = 0.5f * (wide(y + 1, x + 2) - wide(y + 1, x));
      images.gradient(i, 1) = 0.5f * (wide(y + 2, x + 1) - wide(y, x + 1));
    }
  }
  images.grey.array() -= images.grey.mean();
  return images;
}

// Columns: d(grey)/d of the entries 00, 10, 01, 11 of the affine map.
AffineImages affine_images(const Gradient& gradient) {
  AffineImages images;
  for (int y = -kRadius, i = 0; y <= kRadius; ++y) {
    for (int x = -kRadius; x <= kRadius; ++x, ++i) {
      images.row(i) << gradient.row(i) * static_cast<float>(x),
          gradient.row(i) * static_cast<float>(y);
    }
  }
  return images;
}

float smaller_eigenvalue(const Eigen::Matrix2f& symmetric) {
  const float half_difference = 0.5f * (symmetric(0, 0) - symmetric(1, 1));
  return 0.5f * symmetric.trace() - std::hypot(half_difference, symmetric(0, 1));
}

// Mean-free, and orthogonal to the mean-free patch: blind to offset and gain.
template <typename Images>
void project_out_brightness(const Column& grey, Images& images) {
  images.rowwise() -= images.colwise().mean();
  images -= grey * ((grey.transpose() * images) / grey.squaredNorm()).eval();
}

}  // namespace

bool inside(const cv::Mat& image, const PatchPlace& place, double radius) {
  const Eigen::Vector2d reach = radius * place.affine.cwiseAbs().rowwise().sum();
  const Eigen::Vector2d lowest = place.pixel - reach, highest = place.pixel + reach;
  // Written so that NaN is outside.
  return lowest.x() >= 1 && lowest.y() >= 1 && highest.x() < image.cols - 2 &&
         highest.y() < image.rows - 2;
}

struct Patch::Model {
  struct Level {
    Eigen::Matrix<float, kArea, 3> images;  // zero-mean grey, steepest descent along x and y
    Eigen::Matrix2f inverse_hessian;
    float energy = 0;  // sum of squares of the zero-mean grey
  };
  struct Affine {
    AffineImages images;       // steepest descent of the affine map's entries
    Matrix6f inverse_hessian;  // with the prior that the map changes little
  };
  std::vector<Level> levels;  // finest first; coarse ones are left out near the border
  Affine affine;

  struct Reading {
    Eigen::Vector3f products;  // of the images with what was sampled
    float gain = 0;            // brightness against the patch
  };

  // The patch as it is sampled at a place, reduced to what the step needs.
  Reading read(const cv::Mat& image, const PatchPlace& place, std::size_t level,
               Column& samples) const {
    sample<kSide>(image, place, samples.data());
    Reading reading;
    reading.products = levels[level].images.transpose() * samples;
    reading.gain = reading.products(0) / levels[level].energy;
    return reading;
  }

  // Of the translation, px of the patch on that level.
  Eigen::Vector2f step_of(const Reading& reading, std::size_t level) const {
    return levels[level].inverse_hessian * reading.products.tail<2>() / reading.gain;
  }

  // Translation alone. Nothing when it leaves the image, wanders off or fades.
  std::optional<Eigen::Vector2d> shift(const cv::Mat& image, PatchPlace place, std::size_t level,
                                       const AlignmentConfig& config) const {
    const Eigen::Vector2d entry = place.pixel;
    const double converged = level == 0 ? config.converged_step : config.coarse_step;
    Column samples;
    for (int i = 0; i < config.max_iterations; ++i) {
      if (!inside(image, place, kRadius)) return std::nullopt;
      const Reading reading = read(image, place, level, samples);
      if (reading.gain < kMinGain) return std::nullopt;
      const Eigen::Vector2d moved = place.affine * step_of(reading, level).cast<double>();
      place.pixel -= moved;
      if (moved.squaredNorm() < converged * converged) break;
    }
    if ((place.pixel - entry).norm() > kSide) return std::nullopt;
    return place.pixel;
  }

  // By one step of translation, px of the image itself.
  std::optional<Eigen::Vector2d> step_on(const cv::Mat& image, PatchPlace place,
                                         std::size_t level) const {
    const double scale = 1 << level;
    place.pixel /= scale;
    if (!inside(image, place, kRadius)) return std::nullopt;
    Column samples;
    const Reading reading = read(image, place, level, samples);
    if (reading.gain < kMinGain) return std::nullopt;
    return -scale * place.affine * step_of(reading, level).cast<double>();
  }

  // One step of all six parameters in the image itself.
  std::optional<PatchFit> warp(const cv::Mat& image, const PatchPlace& place) const {
    if (!inside(image, place, kRadius)) return std::nullopt;
    Column samples;
    const Reading reading = read(image, place, 0, samples);
    if (reading.gain < kMinGain) return std::nullopt;
    Vector6f slope;
    slope.head<2>() = reading.products.tail<2>();
    slope.tail<4>() = affine.images.transpose() * samples;
    const Vector6f step = affine.inverse_hessian * slope / reading.gain;
    Eigen::Matrix2d step_map = Eigen::Matrix2d::Identity();
    step_map += Eigen::Map<const Eigen::Matrix2f>(step.data() + 2).cast<double>();
    PatchFit aligned;
    aligned.place.affine = place.affine * step_map.inverse();
    aligned.place.pixel = place.pixel - aligned.place.affine * step.head<2>().cast<double>();
    const float energy = (samples.array() - samples.mean()).matrix().squaredNorm();
    aligned.correlation = reading.products(0) / std::sqrt(levels[0].energy * energy);
    aligned.covariance = covariance(aligned);
    return aligned;
  }

  // Eight of the pixels are spent on place, map, gain and offset.
  Eigen::Matrix2d covariance(const PatchFit& fit) const {
    const double unlike = std::max(0.0, 1 - fit.correlation * fit.correlation);
    const double variance = levels[0].energy * unlike / (kArea - 8);
    const Eigen::Matrix2d spread = affine.inverse_hessian.topLeftCorner<2, 2>().cast<double>();
    const Eigen::Matrix2d& A = fit.place.affine;
    return variance * A * spread * A.transpose();
  }
};

Patch::Patch(std::unique_ptr<const Model> model) : model_(std::move(model)) {}
Patch::Patch(Patch&&) noexcept = default;
Patch& Patch::operator=(Patch&&) noexcept = default;
Patch::~Patch() = default;

std::optional<Patch> Patch::cut(const ImagePyramid& pyramid, const Eigen::Vector2d& pixel,
                                const AlignmentConfig& config) {
  auto model = std::make_unique<Model>();
  for (std::size_t l = 0; l < pyramid.levels.size(); ++l) {
    PatchPlace place;
    place.pixel = pixel / (1 << l);
    if (!inside(pyramid.levels[l], place, kRadius + 1)) break;
    PatchImages images = cut_images(pyramid.levels[l], place);
    AffineImages affine;
    if (l == 0) affine = affine_images(images.gradient);
    project_out_brightness(images.grey, images.gradient);
    const Eigen::Matrix2f hessian = images.gradient.transpose() * images.gradient;
    const double weakest = smaller_eigenvalue(hessian);
    // Written so that a patch without any texture, which gives no number at all, stops here too.
    if (!(weakest > kArea * config.min_texture * config.min_texture)) break;
    Model::Level level;
    level.images << images.grey, images.gradient;
    level.inverse_hessian = hessian.inverse();
    level.energy = images.grey.squaredNorm();
    model->levels.push_back(level);
    if (l > 0) continue;
    project_out_brightness(images.grey, affine);
    Eigen::Matrix<float, kArea, 6> all;
    all << images.gradient, affine;
    Matrix6f H = all.transpose() * all;
    const auto prior = static_cast<float>(config.grey_sigma / config.affine_sigma);
    H.diagonal().tail<4>().array() += prior * prior;
    model->affine.images = affine;
    model->affine.inverse_hessian = H.inverse();
  }
  if (model->levels.empty()) return std::nullopt;
  return Patch(std::move(model));
}

std::optional<PatchFit> Patch::align(const ImagePyramid& pyramid, const PatchPlace& start,
                                     int levels, const AlignmentConfig& config) const {
  PatchPlace place = start;
  const std::size_t used = std::min(model_->levels.size(), static_cast<std::size_t>(levels));
  for (std::size_t l = used; l-- > 0;) {
    PatchPlace scaled = place;
    scaled.pixel /= (1 << l);
    const auto pixel = model_->shift(pyramid.levels[l], scaled, l, config);
    if (pixel) place.pixel = *pixel * (1 << l);
    if (!pixel && l == 0) return std::nullopt;
  }
  constexpr int kWarpSteps = 2;
  std::optional<PatchFit> aligned;
  for (int i = 0; i < kWarpSteps; ++i) {
    aligned = model_->warp(pyramid.levels[0], place);
    if (!aligned) return std::nullopt;
    place = aligned->place;
  }
  if (config.compare_scales && used > 1) {
    aligned->coarse_shift = model_->step_on(pyramid.levels[1], place, 1);
  }
  return aligned;
}

}  // namespace covey
