// SPDX-License-Identifier: Apache-2.0
//
// Grey images out of what cameras' drivers send: encodings of sensor_msgs/Image, as
// sensor_msgs/image_encodings.hpp names them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

namespace covey {

struct PixelFormat {
  enum class Kind : std::uint8_t {
    kGrey,        // of one byte or two
    kColours,     // red, green and blue
    kBrightness,  // in one byte, colour in others
    kMosaic,      // Bayer's: one colour each, red, green twice and blue in every 2 x 2 pixels
  };
  Kind kind = Kind::kGrey;
  std::size_t bytes = 1;                        // of one pixel
  std::array<std::size_t, 3> red_green_blue{};  // kColours: which bytes of it
  std::size_t brightness = 0;                   // kBrightness: which byte of it
};

// Nothing for an encoding that cannot be read; those that can:
[[nodiscard]] std::optional<PixelFormat> pixel_format(const std::string& encoding);
inline constexpr const char* kReadableEncodings =
    "mono8, mono16, rgb8, bgr8, rgba8, bgra8, yuyv, uyvy, nv12, nv21 and bayer_* of 8 bits";

struct PixelRows {
  std::size_t width = 0, height = 0;  // pixels
  std::size_t step = 0;               // bytes from row to row, at least those of its pixels
  bool big_endian = false;
};

// Rows without gaps, of pixels of one byte, or of two in this machine's order. `data`: at least
// step x height bytes.
[[nodiscard]] std::vector<std::uint8_t> grey_pixels(const PixelFormat& format,
                                                    const PixelRows& rows,
                                                    std::vector<std::uint8_t> data);

[[nodiscard]] bool is_big_endian_machine();

}  // namespace covey
