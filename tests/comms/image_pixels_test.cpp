// SPDX-License-Identifier: Apache-2.0
#include "comms/image_pixels.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace covey {
namespace {

using testing::Each;
using testing::ElementsAre;
using Pixels = std::vector<std::uint8_t>;

Pixels read_as(const std::string& encoding, const PixelRows& rows, const Pixels& data) {
  const auto format = pixel_format(encoding);
  if (!format) {
    ADD_FAILURE() << encoding;
    return {};
  }
  return grey_pixels(*format, rows, data);
}

// Two rows of two pixels, with a byte of no meaning behind each row.
TEST(ImagePixels, BrightnessIsTakenFromBesideTheColour) {
  const Pixels yuyv = {10, 1, 20, 2, 99, 30, 3, 40, 4, 99};
  const Pixels uyvy = {1, 10, 2, 20, 99, 3, 30, 4, 40, 99};
  const PixelRows rows{2, 2, 5, false};
  for (const char* name : {"yuyv", "yuv422_yuy2"})
    EXPECT_THAT(read_as(name, rows, yuyv), ElementsAre(10, 20, 30, 40)) << name;
  for (const char* name : {"uyvy", "yuv422"})
    EXPECT_THAT(read_as(name, rows, uyvy), ElementsAre(10, 20, 30, 40)) << name;
}

TEST(ImagePixels, OfPlanesTheFirstIsTaken) {
  const Pixels planes = {10, 20, 30, 40, 128, 128};
  for (const char* name : {"nv12", "nv21"})
    EXPECT_THAT(read_as(name, {2, 2, 2, false}, planes), ElementsAre(10, 20, 30, 40)) << name;
}

struct Colour {
  std::uint8_t red = 0, green = 0, blue = 0;
};

// What a sensor sees of one colour through such a mosaic: "rggb" row by row.
Pixels mosaic_of(const Colour& colour, const std::string& order, std::size_t width,
                 std::size_t height) {
  Pixels pixels;
  for (std::size_t y = 0; y < height; ++y) {
    for (std::size_t x = 0; x < width; ++x) {
      const char seen = order[2 * (y % 2) + x % 2];
      pixels.push_back(seen == 'r' ? colour.red : seen == 'g' ? colour.green : colour.blue);
    }
  }
  return pixels;
}

TEST(ImagePixels, OneColourIsOneGreyThroughAnyMosaic) {
  const Colour colour{40, 100, 200};
  constexpr int kGrey = (40 + 2 * 100 + 200) / 4;
  for (const std::string order : {"rggb", "bggr", "gbrg", "grbg"}) {
    for (const std::size_t width : {2, 5, 8}) {
      for (const std::size_t height : {2, 7}) {
        const Pixels seen = mosaic_of(colour, order, width, height);
        EXPECT_THAT(read_as("bayer_" + order + "8", {width, height, width, false}, seen),
                    Each(kGrey))
            << order << ' ' << width << 'x' << height;
      }
    }
  }
}

TEST(ImagePixels, AMosaicMovesNothing) {
  constexpr std::size_t kWidth = 6, kHeight = 5;
  Pixels ramp;
  for (std::size_t y = 0; y < kHeight; ++y) {
    for (std::size_t x = 0; x < kWidth; ++x)
      ramp.push_back(static_cast<std::uint8_t>(20 * x + 10 * y));
  }
  const Pixels grey = read_as("bayer_rggb8", {kWidth, kHeight, kWidth, false}, ramp);
  for (std::size_t y = 1; y + 1 < kHeight; ++y) {
    for (std::size_t x = 1; x + 1 < kWidth; ++x)
      EXPECT_EQ(grey[y * kWidth + x], ramp[y * kWidth + x]) << x << ' ' << y;
  }
}

TEST(ImagePixels, AMosaicOfOnePixelIsThatPixel) {
  EXPECT_THAT(read_as("bayer_rggb8", {1, 1, 1, false}, {77}), ElementsAre(77));
}

TEST(ImagePixels, WhiteStaysWhite) {
  EXPECT_THAT(read_as("bayer_gbrg8", {4, 4, 4, false}, Pixels(16, 255)), Each(255));
}

TEST(ImagePixels, WhatCannotBeReadIsNoFormat) {
  for (const char* name : {"", "mono", "yuv420", "bayer_rggb16", "32FC1", "MONO8"})
    EXPECT_FALSE(pixel_format(name)) << name;
}

}  // namespace
}  // namespace covey
