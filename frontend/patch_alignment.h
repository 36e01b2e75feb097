// SPDX-License-Identifier: Apache-2.0
//
// A small patch is cut out once, and found again in later images: inverse compositional alignment
// (Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 2004) over the pyramid. Because every image
// is aligned to the same patch, not to the image before, errors do not add up along a track. The
// patch is warped by an affine map that follows rotation and scale. Gain and offset of the
// brightness are projected out of the steepest-descent images (Hager and Belhumeur 1998), so
// exposure may change.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>

#include "frontend/image_pyramid.h"

namespace covey {

struct AlignmentConfig {
  int max_iterations = 8;        // on each level
  double converged_step = 0.03;  // px in the image itself
  double coarse_step = 0.2;      // px of a coarse level
  double affine_sigma = 0.02;    // change of an entry of the affine map from image to image
  double grey_sigma = 4.0;       // noise of a pixel and what the affine model leaves, grey levels
  bool compare_scales = false;   // PatchFit::coarse_shift
  double min_texture = 0.7;  // mean gradient of the patch in its weakest direction, grey levels/px
};

// Where the patch lies in an image: x_image = pixel + affine * x_patch, px.
struct PatchPlace {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  Eigen::Matrix2d affine = Eigen::Matrix2d::Identity();
};

// Is the warped square of that radius (px of the patch), and the pixel that bilinear sampling looks
// at beyond it, inside the image?
[[nodiscard]] bool inside(const cv::Mat& image, const PatchPlace& place, double radius);

struct PatchFit {
  PatchPlace place;
  double correlation = 0;  // zero-mean normalised, -1..1
  // Of `place.pixel`, px2: what is left of the brightness, taken for noise of one pixel and the
  // next, over the texture that place and map share. White noise makes errors of 1.1 times that at
  // whole pixels, 2 times between them.
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
  // From there to where coarser texture says it is, in the image of half the size, px; if asked
  // for.
  std::optional<Eigen::Vector2d> coarse_shift = std::nullopt;
};

class Patch {
 public:
  static constexpr int kSide = 13;  // px

  // Nothing where the patch leaves the image or has no texture in some direction.
  [[nodiscard]] static std::optional<Patch> cut(const ImagePyramid& pyramid,
                                                const Eigen::Vector2d& pixel,
                                                const AlignmentConfig& config);

  // From a predicted place, on the `levels` finest levels. Nothing when it leaves the image.
  [[nodiscard]] std::optional<PatchFit> align(const ImagePyramid& pyramid, const PatchPlace& start,
                                              int levels, const AlignmentConfig& config) const;

  Patch(Patch&&) noexcept;
  Patch& operator=(Patch&&) noexcept;
  ~Patch();

 private:
  struct Model;
  explicit Patch(std::unique_ptr<const Model> model);
  std::unique_ptr<const Model> model_;
};

}  // namespace covey
