// SPDX-License-Identifier: Apache-2.0
#include "comms/image_pixels.h"

#include <algorithm>
#include <cstring>
#include <map>
#include <utility>

namespace covey {
namespace {

using Pixels = std::vector<std::uint8_t>;
using Kind = PixelFormat::Kind;

// Newer and older names of one layout have one format. The planes of nv12 and nv21 begin with that
// of the brightness.
const std::map<std::string, PixelFormat>& formats() {
  constexpr PixelFormat kGrey{Kind::kGrey, 1, {}, 0}, kDeepGrey{Kind::kGrey, 2, {}, 0};
  constexpr PixelFormat kMosaic{Kind::kMosaic, 1, {}, 0};
  constexpr PixelFormat kYuyv{Kind::kBrightness, 2, {}, 0}, kUyvy{Kind::kBrightness, 2, {}, 1};
  static const std::map<std::string, PixelFormat> kFormats = {
      {"mono8", kGrey},
      {"8UC1", kGrey},
      {"mono16", kDeepGrey},
      {"16UC1", kDeepGrey},
      {"rgb8", {Kind::kColours, 3, {0, 1, 2}, 0}},
      {"bgr8", {Kind::kColours, 3, {2, 1, 0}, 0}},
      {"rgba8", {Kind::kColours, 4, {0, 1, 2}, 0}},
      {"bgra8", {Kind::kColours, 4, {2, 1, 0}, 0}},
      {"yuyv", kYuyv},
      {"yuv422_yuy2", kYuyv},
      {"uyvy", kUyvy},
      {"yuv422", kUyvy},
      {"nv12", kGrey},
      {"nv21", kGrey},
      {"bayer_rggb8", kMosaic},
      {"bayer_bggr8", kMosaic},
      {"bayer_gbrg8", kMosaic},
      {"bayer_grbg8", kMosaic},
  };
  return kFormats;
}

Pixels without_gaps(Pixels data, std::size_t row_bytes, const PixelRows& rows) {
  if (rows.step != row_bytes) {
    for (std::size_t row = 1; row < rows.height; ++row)
      std::memmove(&data[row * row_bytes], &data[row * rows.step], row_bytes);
  }
  data.resize(row_bytes * rows.height);
  return data;
}

// ITU-R BT.601, in 256ths.
void keep_brightness_of_colours(const PixelFormat& format, Pixels& pixels) {
  constexpr unsigned kRed = 77, kGreen = 150, kBlue = 29, kHalf = 128;
  const auto [red, green, blue] = format.red_green_blue;
  const std::size_t count = pixels.size() / format.bytes;
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* const pixel = &pixels[i * format.bytes];
    const unsigned sum = kRed * pixel[red] + kGreen * pixel[green] + kBlue * pixel[blue];
    pixels[i] = static_cast<std::uint8_t>((sum + kHalf) >> 8U);
  }
  pixels.resize(count);
}

void keep_brightness(const PixelFormat& format, Pixels& pixels) {
  const std::size_t count = pixels.size() / format.bytes;
  for (std::size_t i = 0; i < count; ++i) pixels[i] = pixels[i * format.bytes + format.brightness];
  pixels.resize(count);
}

// Its neighbours among `count`; beyond the ends mirrored about them, which keeps colours in their
// places.
std::size_t before(std::size_t i, std::size_t count) {
  return i > 0 ? i - 1 : std::min<std::size_t>(1, count - 1);
}
std::size_t after(std::size_t i, std::size_t count) {
  return i + 1 < count ? i + 1 : count - std::min<std::size_t>(2, count);
}

// (1 2 1) both ways takes a quarter of its weight from red, half from green and a quarter from blue
// wherever it stands, whichever of the four orders the colours have, and shifts nothing.
void smooth_mosaic(const PixelRows& rows, Pixels& pixels) {
  constexpr unsigned kSum = 16, kHalf = kSum / 2;
  const std::size_t width = rows.width, height = rows.height;
  std::vector<std::uint16_t> along_rows(pixels.size());
  for (std::size_t y = 0; y < height; ++y) {
    const std::uint8_t* const in = &pixels[y * width];
    std::uint16_t* const out = &along_rows[y * width];
    for (std::size_t x = 0; x < width; ++x)
      out[x] = static_cast<std::uint16_t>(in[before(x, width)] + 2 * in[x] + in[after(x, width)]);
  }
  for (std::size_t y = 0; y < height; ++y) {
    const std::uint16_t* const above = &along_rows[before(y, height) * width];
    const std::uint16_t* const here = &along_rows[y * width];
    const std::uint16_t* const below = &along_rows[after(y, height) * width];
    for (std::size_t x = 0; x < width; ++x) {
      const unsigned sum = above[x] + 2U * here[x] + below[x];
      pixels[y * width + x] = static_cast<std::uint8_t>((sum + kHalf) / kSum);
    }
  }
}

void swap_bytes(Pixels& pixels) {
  for (std::size_t i = 0; i + 1 < pixels.size(); i += 2) std::swap(pixels[i], pixels[i + 1]);
}

}  // namespace

std::optional<PixelFormat> pixel_format(const std::string& encoding) {
  const auto format = formats().find(encoding);
  if (format == formats().end()) return std::nullopt;
  return format->second;
}

std::vector<std::uint8_t> grey_pixels(const PixelFormat& format, const PixelRows& rows,
                                      std::vector<std::uint8_t> data) {
  Pixels pixels = without_gaps(std::move(data), rows.width * format.bytes, rows);
  switch (format.kind) {
    case Kind::kGrey:
      if (format.bytes == 2 && rows.big_endian != is_big_endian_machine()) swap_bytes(pixels);
      break;
    case Kind::kColours:
      keep_brightness_of_colours(format, pixels);
      break;
    case Kind::kBrightness:
      keep_brightness(format, pixels);
      break;
    case Kind::kMosaic:
      smooth_mosaic(rows, pixels);
      break;
  }
  return pixels;
}

bool is_big_endian_machine() {
  const std::uint16_t one = 1;
  std::uint8_t first = 0;
  std::memcpy(&first, &one, 1);
  return first == 0;
}

}  // namespace covey
