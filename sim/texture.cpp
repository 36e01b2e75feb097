// SPDX-License-Identifier: Apache-2.0
#include "sim/texture.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstring>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace covey {
namespace {

constexpr float kLevelBias = 0.25f;  // octaves; about the blur of a real lens at best focus
constexpr int kMaxTaps = 5;          // along the major axis of a footprint

int fast_floor(float x) {
  const int i = static_cast<int>(x);
  return i - (x < static_cast<float>(i) ? 1 : 0);
}

// log2 to about 0.01: plenty for choosing a level of detail.
float fast_log2(float x) {
  std::uint32_t bits = 0;
  std::memcpy(&bits, &x, sizeof bits);
  const float exponent = static_cast<float>(static_cast<int>(bits >> 23) - 127);
  bits = (bits & 0x007fffffu) | 0x3f800000u;
  float mantissa = 0;
  std::memcpy(&mantissa, &bits, sizeof mantissa);
  return exponent + (-0.33333f * mantissa + 2.0f) * mantissa - 1.66667f;
}

float bilinear(const std::uint8_t* texels, int size, float x, float y) {
  const int x0 = fast_floor(x), y0 = fast_floor(y), mask = size - 1;
  const float fx = x - static_cast<float>(x0), fy = y - static_cast<float>(y0);
  const std::uint8_t* row0 = texels + static_cast<std::size_t>(y0 & mask) * size;
  const std::uint8_t* row1 = texels + static_cast<std::size_t>((y0 + 1) & mask) * size;
  const int c0 = x0 & mask, c1 = (x0 + 1) & mask;
  const float top = row0[c0] + fx * (row0[c1] - row0[c0]);
  const float bottom = row1[c0] + fx * (row1[c1] - row1[c0]);
  return top + fy * (bottom - top);
}

std::vector<std::uint8_t> halve(const std::vector<std::uint8_t>& fine, int size) {
  const int half = size / 2;
  std::vector<std::uint8_t> coarse(static_cast<std::size_t>(half) * half);
  for (int y = 0; y < half; ++y) {
    const std::uint8_t* a = fine.data() + static_cast<std::size_t>(2 * y) * size;
    const std::uint8_t* b = a + size;
    std::uint8_t* out = coarse.data() + static_cast<std::size_t>(y) * half;
    for (int x = 0; x < half; ++x, a += 2, b += 2)
      out[x] = static_cast<std::uint8_t>((a[0] + a[1] + b[0] + b[1] + 2) / 4);
  }
  return coarse;
}

// Paints shapes that wrap around the edges of the periodic texture.
class Painter {
 public:
  Painter(const cv::Mat& canvas, float texel_m, std::uint64_t seed)
      : canvas_(canvas), texel_m_(texel_m), rng_(seed) {}

  [[nodiscard]] double uniform(double low, double high) { return rng_.uniform(low, high); }
  [[nodiscard]] double side_m() const { return canvas_.cols * static_cast<double>(texel_m_); }
  [[nodiscard]] int grey_at(double u, double v) const {
    return canvas_.at<std::uint8_t>(wrap(v), wrap(u));
  }

  void rectangle(double u, double v, double width, double height, int grey) {
    polygon({{u, v}, {u + width, v}, {u + width, v + height}, {u, v + height}}, grey);
  }

  void polygon(const std::vector<cv::Point2d>& corners_m, int grey) {
    constexpr int kShift = 4;
    cv::Point2d low(1e9, 1e9), high(-1e9, -1e9);
    for (const auto& c : corners_m) {
      low = {std::min(low.x, c.x), std::min(low.y, c.y)};
      high = {std::max(high.x, c.x), std::max(high.y, c.y)};
    }
    const double side = side_m();
    for (const double du : shifts(low.x, high.x))
      for (const double dv : shifts(low.y, high.y)) {
        std::vector<cv::Point> points;
        points.reserve(corners_m.size());
        for (const auto& c : corners_m)
          points.emplace_back(cvRound((c.x + du * side) / texel_m_ * (1 << kShift)),
                              cvRound((c.y + dv * side) / texel_m_ * (1 << kShift)));
        cv::fillConvexPoly(canvas_, points, cv::Scalar(grey), cv::LINE_8, kShift);
      }
  }

  // A convex polygon of 3 to 6 corners around (u, v), of random shape and direction.
  void patch(double u, double v, double radius, int grey) {
    const int n = rng_.uniform(3, 7);
    const double start = uniform(0, CV_2PI), squeeze = uniform(0.45, 1.0);
    const double c = std::cos(start), s = std::sin(start);
    std::vector<cv::Point2d> corners;
    for (int i = 0; i < n; ++i) {
      const double angle = CV_2PI * (i + uniform(-0.3, 0.3)) / n;
      const double a = radius * std::cos(angle), b = radius * squeeze * std::sin(angle);
      corners.emplace_back(u + c * a - s * b, v + s * a + c * b);
    }
    polygon(corners, grey);
  }

 private:
  [[nodiscard]] int wrap(double metres) const {
    return fast_floor(static_cast<float>(metres / texel_m_)) & (canvas_.cols - 1);
  }
  [[nodiscard]] std::vector<double> shifts(double low, double high) const {
    std::vector<double> all{0};
    if (low < 0) all.push_back(1);
    if (high >= side_m()) all.push_back(-1);
    return all;
  }

  cv::Mat canvas_;  // shares the pixels of the texture being painted
  float texel_m_;
  cv::RNG rng_;
};

// Patches from large to small, equal area for each octave: edges and corners at every distance.
struct PatchLayer {
  double largest_m = 2.0, smallest_m = 0.04;  // radius
  double cover = 0.3;                         // fraction of the area painted for each octave
  int contrast = 80;                          // grey levels from what lies below
};

void paint_patches(Painter& painter, const PatchLayer& layer) {
  const double area = painter.side_m() * painter.side_m();
  const int octaves = 1 + static_cast<int>(std::log2(layer.largest_m / layer.smallest_m) + 1e-9);
  for (int octave = 0; octave < octaves; ++octave) {
    const double radius = std::ldexp(layer.largest_m, -octave);
    const int count = static_cast<int>(layer.cover * area / (1.2 * radius * radius));
    for (int i = 0; i < count; ++i) {
      const double u = painter.uniform(0, painter.side_m());
      const double v = painter.uniform(0, painter.side_m());
      const double sign = painter.uniform(-1, 1) < 0 ? -1 : 1;
      const int step = static_cast<int>(sign * painter.uniform(0.35, 1.0) * layer.contrast);
      int grey = painter.grey_at(u, v) + step;
      if (grey < 10 || grey > 245) grey -= 2 * step;
      painter.patch(u, v, radius * painter.uniform(0.6, 1.1), std::clamp(grey, 5, 250));
    }
  }
}

void paint_course(Painter& painter, double v, double height) {
  const double side = painter.side_m();
  const double mortar = painter.uniform(0.02, 0.05);
  for (double u = 0; u < side;) {
    double width = height * painter.uniform(0.7, 2.6);
    if (side - u - width < 0.4) width = side - u;
    const double dark = painter.uniform(0, 1) < 0.12 ? -50 : 0;
    const int grey = static_cast<int>(painter.uniform(105, 205) + dark);
    painter.rectangle(u + mortar / 2, v + mortar / 2, width - mortar, height - mortar, grey);
    u += width;
  }
}

void paint_window(Painter& painter, double u, double v) {
  const double width = painter.uniform(0.6, 1.5), height = width * painter.uniform(1.2, 2.0);
  const double frame = painter.uniform(0.1, 0.22);
  painter.rectangle(u - frame, v - frame, width + 2 * frame, height + 2 * frame,
                    static_cast<int>(painter.uniform(190, 240)));
  const int columns = painter.uniform(0, 1) < 0.5 ? 2 : 3, rows = columns + 1;
  const double bar = 0.05;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < columns; ++c)
      painter.rectangle(u + c * width / columns + bar / 2, v + r * height / rows + bar / 2,
                        width / columns - bar, height / rows - bar,
                        static_cast<int>(painter.uniform(15, 60)));
}

void paint_windows(Painter& painter) {
  constexpr double kSpacing = 5.0;  // m
  const int n = static_cast<int>(painter.side_m() / kSpacing);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      if (painter.uniform(0, 1) < 0.35) continue;
      const double u = (i + painter.uniform(0.1, 0.6)) * painter.side_m() / n;
      const double v = (j + painter.uniform(0.1, 0.5)) * painter.side_m() / n;
      paint_window(painter, u, v);
    }
}

// A crack wanders and is a few centimetres wide.
void paint_cracks(Painter& painter, int count) {
  for (int i = 0; i < count; ++i) {
    double u = painter.uniform(0, painter.side_m()), v = painter.uniform(0, painter.side_m());
    double heading = painter.uniform(0, CV_2PI);
    for (int k = 0; k < 12; ++k) {
      heading += painter.uniform(-0.7, 0.7);
      const double length = painter.uniform(0.1, 0.35), width = painter.uniform(0.015, 0.04);
      const cv::Point2d along(length * std::cos(heading), length * std::sin(heading));
      const cv::Point2d across(-width * std::sin(heading), width * std::cos(heading));
      const cv::Point2d from(u, v), to = from + along;
      painter.polygon({from, to, to + across, from + across}, 40);
      u = std::fmod(to.x + painter.side_m(), painter.side_m());
      v = std::fmod(to.y + painter.side_m(), painter.side_m());
    }
  }
}

// Twice the size, periodic: the border is wrapped before the interpolation and cut off after it.
cv::Mat upsample_periodic(const cv::Mat& small) {
  constexpr int kBorder = 4;
  cv::Mat padded, large;
  cv::copyMakeBorder(small, padded, kBorder, kBorder, kBorder, kBorder, cv::BORDER_WRAP);
  cv::resize(padded, large, cv::Size(), 2, 2, cv::INTER_LINEAR);
  return large(cv::Rect(2 * kBorder, 2 * kBorder, 2 * small.cols, 2 * small.rows)).clone();
}

// Noise of all octaves down to the texel, coarse to fine: each octave has `gain` of the one above.
// CV_32FC1, zero mean; unit deviation at the octave of `top` cells over the side.
cv::Mat octave_noise(int size, int top, float gain, cv::RNG& rng) {
  cv::Mat sum(top, top, CV_32FC1);
  rng.fill(sum, cv::RNG::NORMAL, 0, 1);
  float amplitude = 1;
  while (sum.cols < size) {
    sum = upsample_periodic(sum);
    amplitude *= gain;
    cv::Mat detail(sum.size(), CV_32FC1);
    rng.fill(detail, cv::RNG::NORMAL, 0, amplitude);
    sum += detail;
  }
  return sum;
}

struct NoiseLayer {
  int top = 8;             // cells over the side in the coarsest octave
  float gain = 0.8f;       // of each octave to the one above
  double grey_levels = 9;  // deviation of the coarsest octave
};

void add_noise(cv::Mat& canvas, const NoiseLayer& layer, cv::RNG& rng) {
  const cv::Mat noise = octave_noise(canvas.cols, layer.top, layer.gain, rng);
  cv::add(canvas, noise * layer.grey_levels, canvas, cv::noArray(), CV_8U);
}

// Edges painted on the texel grid get the width of a texel.
void soften(cv::Mat& canvas, double sigma_texels = 0.6) {
  constexpr int kBorder = 4;
  cv::Mat padded, blurred;
  cv::copyMakeBorder(canvas, padded, kBorder, kBorder, kBorder, kBorder, cv::BORDER_WRAP);
  cv::GaussianBlur(padded, blurred, cv::Size(), sigma_texels);
  blurred(cv::Rect(kBorder, kBorder, canvas.cols, canvas.rows)).copyTo(canvas);
}

// What every painted surface ends with.
Texture weathered(cv::Mat& canvas, const TextureSpec& spec, const NoiseLayer& noise) {
  cv::RNG rng(spec.seed ^ 0x5eed5eedULL);
  add_noise(canvas, noise, rng);
  soften(canvas);
  return {canvas, spec.texel_m};
}

}  // namespace

Texture::Texture(const cv::Mat& base, float texel_m) : size_(base.cols), texel_m_(texel_m) {
  assert(base.type() == CV_8UC1 && base.rows == base.cols && (size_ & (size_ - 1)) == 0);
  const cv::Mat packed = base.isContinuous() ? base : base.clone();
  levels_.emplace_back(packed.data, packed.data + packed.total());
  for (int size = size_; size > 1; size /= 2) levels_.push_back(halve(levels_.back(), size));
}

float Texture::trilinear(float x, float y, float level) const {
  const float last = static_cast<float>(levels_.size() - 1);
  level = std::clamp(level, 0.0f, last);
  const int fine = static_cast<int>(level);
  // One level alone near each whole number: continuous, and two fifths of the reads saved.
  const float blend = std::clamp((level - static_cast<float>(fine) - 0.2f) / 0.6f, 0.0f, 1.0f);
  const auto at_level = [&](int k) {
    // Texel centres lie at half-integers of every level.
    const float scale = 1.0f / static_cast<float>(1 << k);
    return bilinear(levels_[k].data(), size_ >> k, x * scale - 0.5f, y * scale - 0.5f);
  };
  if (blend <= 0) return at_level(fine);
  const int coarse = std::min(fine + 1, static_cast<int>(levels_.size()) - 1);
  if (blend >= 1) return at_level(coarse);
  const float a = at_level(fine);
  return a + blend * (at_level(coarse) - a);
}

float Texture::sample(float u, float v, float width) const {
  const float to_texel = 1.0f / texel_m_;
  return trilinear(u * to_texel, v * to_texel, fast_log2(width * to_texel) + kLevelBias) / 255.0f;
}

float Texture::sample(float u, float v, const Footprint& footprint) const {
  const float ratio = footprint.major / footprint.minor;
  if (ratio < 1.4f) return sample(u, v, 0.5f * (footprint.minor + footprint.major));
  const int taps = std::min(kMaxTaps, static_cast<int>(0.75f * ratio + 0.6f));
  const float step = footprint.major / static_cast<float>(taps), to_texel = 1.0f / texel_m_;
  const float level = fast_log2(std::max(footprint.minor, step) * to_texel) + kLevelBias;
  const float first = -0.5f * step * static_cast<float>(taps - 1);
  float sum = 0;
  for (int i = 0; i < taps; ++i) {
    const float offset = first + step * static_cast<float>(i);
    sum += trilinear((u + offset * footprint.major_u) * to_texel,
                     (v + offset * footprint.major_v) * to_texel, level);
  }
  return sum / (255.0f * static_cast<float>(taps));
}

Texture make_masonry(const TextureSpec& spec) {
  cv::Mat canvas(spec.size, spec.size, CV_8UC1, cv::Scalar(70));
  Painter painter(canvas, spec.texel_m, spec.seed);
  const double side = painter.side_m();
  for (double v = 0; v < side;) {
    double height = painter.uniform(0.28, 0.75);
    if (side - v - height < 0.3) height = side - v;
    paint_course(painter, v, height);
    v += height;
  }
  paint_patches(painter, {2.0, 0.06, 0.05, 60});
  paint_windows(painter);
  paint_patches(painter, {0.5, 4.0 * spec.texel_m, 0.06, 90});
  paint_cracks(painter, static_cast<int>(0.3 * side * side));
  return weathered(canvas, spec, {8, 0.8f, 9.0});
}

Texture make_patches(const TextureSpec& spec) {
  cv::Mat canvas(spec.size, spec.size, CV_8UC1, cv::Scalar(120));
  Painter painter(canvas, spec.texel_m, spec.seed);
  paint_patches(painter, {4.0, 3.5 * spec.texel_m, 0.25, 75});
  return weathered(canvas, spec, {8, 0.8f, 8.0});
}

Texture make_soil(const TextureSpec& spec) {
  cv::Mat canvas(spec.size, spec.size, CV_8UC1, cv::Scalar(125));
  Painter painter(canvas, spec.texel_m, spec.seed);
  paint_patches(painter, {2.0, 3.0 * spec.texel_m, 0.28, 70});
  soften(canvas, 0.9);
  return weathered(canvas, spec, {16, 0.85f, 10.0});
}

Texture make_soft_noise(const TextureSpec& spec) {
  cv::Mat canvas(spec.size, spec.size, CV_8UC1, cv::Scalar(128));
  cv::RNG rng(spec.seed);
  add_noise(canvas, {8, 0.6f, 40.0}, rng);
  return {canvas, spec.texel_m};
}

}  // namespace covey
