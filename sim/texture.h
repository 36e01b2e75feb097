// SPDX-License-Identifier: Apache-2.0
//
// Procedural textures: square, periodic, 8-bit, sampled with trilinear filtering so that the image
// of a corner does not shimmer when the camera moves.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <vector>

namespace covey {

// What the pixel sees of a surface: an ellipse in texture coordinates, all lengths in metres.
struct Footprint {
  float minor = 0.01f;             // across the viewing direction
  float major = 0.01f;             // along it, longer by 1/cos(incidence)
  float major_u = 1, major_v = 0;  // unit direction of the major axis
};

class Texture {
 public:
  // `base` is CV_8UC1, square, its side a power of two; it repeats every base.cols * texel_m.
  Texture(const cv::Mat& base, float texel_m);

  // Mean grey level in [0, 1] over the footprint centred at (u, v) metres.
  [[nodiscard]] float sample(float u, float v, const Footprint& footprint) const;
  // The same for a round footprint of the given width.
  [[nodiscard]] float sample(float u, float v, float width) const;

 private:
  [[nodiscard]] float trilinear(float x, float y, float level) const;

  std::vector<std::vector<std::uint8_t>> levels_;  // level k has (size >> k) squared texels
  int size_ = 0;
  float texel_m_ = 0.01f;
};

struct TextureSpec {
  int size = 4096;        // texels, a power of two
  float texel_m = 0.01f;  // m
  std::uint64_t seed = 1;
};

// Masonry: courses of blocks of varied sizes, mortar, windows, stains and cracks.
[[nodiscard]] Texture make_masonry(const TextureSpec& spec);
// Patches with sharp edges, radius 4 m down to a few texels: gravel, leaves, cluttered walls.
[[nodiscard]] Texture make_patches(const TextureSpec& spec);
// The same without hard edges: heat spreads in the ground over a centimetre or two.
[[nodiscard]] Texture make_soil(const TextureSpec& spec);
// Soft noise of many octaves, without edges: clouds, sand, large stains.
[[nodiscard]] Texture make_soft_noise(const TextureSpec& spec);

}  // namespace covey
