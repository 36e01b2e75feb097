// SPDX-License-Identifier: Apache-2.0
//
// Images that were packed by libjpeg-turbo and libspng come back as they were.
#include "apps/packed_image.h"

#include <gtest/gtest.h>
#include <turbojpeg.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <opencv2/core.hpp>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "apps/camera_pixels.h"
#include "tests/apps/png_bytes.h"

namespace covey {
namespace {

constexpr TimeNs kStamp_ns = 1'700'000'000'000'000'000;
constexpr int kWidth = 48, kHeight = 32;

// Bright to the right and darker downwards, so that JPEG keeps it.
cv::Mat slope(int type) {
  cv::Mat image(kHeight, kWidth, type);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      const int level = 40 + 4 * x - y;
      if (type == CV_16UC1) image.at<std::uint16_t>(y, x) = static_cast<std::uint16_t>(100 * level);
      if (type == CV_8UC1) image.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(level);
    }
  }
  return image;
}

Bytes jpeg_of(const cv::Mat& image) {
  const bool grey = image.type() == CV_8UC1;
  unsigned char* packed = nullptr;
  unsigned long size = 0;
  const tjhandle packer = tjInitCompress();
  EXPECT_EQ(tjCompress2(packer, image.data, image.cols, 0, image.rows, grey ? TJPF_GRAY : TJPF_RGB,
                        &packed, &size, grey ? TJSAMP_GRAY : TJSAMP_420, 100, 0),
            0);
  Bytes bytes(packed, packed + size);
  tjFree(packed);
  tjDestroy(packer);
  return bytes;
}

CameraImage image_in(const std::string& format, const Bytes& file) {
  Decoded<CameraImage> decoded = unpacked({kStamp_ns, format, file});
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) {
    ADD_FAILURE() << rejected->reason;
    return {};
  }
  return std::move(std::get<CameraImage>(decoded));
}

std::string rejected(const Bytes& file) {
  const Decoded<CameraImage> decoded = unpacked({kStamp_ns, "jpeg", file});
  const auto* reason = std::get_if<Rejected>(&decoded);
  return reason != nullptr ? reason->reason : "accepted";
}

double largest_difference(CameraImage image, const cv::Mat& expected) {
  const cv::Mat pixels = pixels_of(image);
  EXPECT_EQ(pixels.type(), expected.type());
  EXPECT_EQ(pixels.size(), expected.size());
  return cv::norm(pixels, expected, cv::NORM_INF);
}

TEST(CameraPixels, PartOfALargerImageIsCopiedAsSeen) {
  const cv::Mat whole = slope(CV_16UC1);
  for (const cv::Mat& part : {cv::Mat(whole.rowRange(3, 9)), cv::Mat(whole.colRange(3, 9))})
    EXPECT_EQ(largest_difference(to_camera_image(kStamp_ns, part), part), 0);
}

TEST(PackedImage, PngOfEitherDepthComesBackBitForBit) {
  for (const int type : {CV_8UC1, CV_16UC1}) {
    const CameraImage image = image_in("mono16; png compressed ", png_of(slope(type)));
    EXPECT_EQ(image.stamp_ns, kStamp_ns);
    EXPECT_EQ(largest_difference(image, slope(type)), 0);
  }
}

TEST(PackedImage, JpegComesBackAsItLooked) {
  const CameraImage image = image_in("jpeg", jpeg_of(slope(CV_8UC1)));
  EXPECT_EQ(image.stamp_ns, kStamp_ns);
  EXPECT_LE(largest_difference(image, slope(CV_8UC1)), 2);
}

TEST(PackedImage, OfColoursTheBrightnessIsRead) {
  const cv::Mat red(kHeight, kWidth, CV_8UC3, cv::Scalar(255, 0, 0));
  const cv::Mat brightness(kHeight, kWidth, CV_8UC1, cv::Scalar(76));
  EXPECT_LE(largest_difference(image_in("rgb8; jpeg compressed bgr8", jpeg_of(red)), brightness),
            2);
  EXPECT_LE(largest_difference(image_in("rgb8; png compressed bgr8", png_of(red)), brightness), 1);
}

TEST(PackedImage, AMosaicIsResolvedUnlessItWasMadeColoursBefore) {
  cv::Mat mosaic(kHeight, kWidth, CV_8UC1, cv::Scalar(100));
  for (int y = 0; y < kHeight; y += 2) {
    for (int x = 0; x < kWidth; x += 2) {
      mosaic.at<std::uint8_t>(y, x) = 40;
      mosaic.at<std::uint8_t>(y + 1, x + 1) = 200;
    }
  }
  const cv::Mat brightness(kHeight, kWidth, CV_8UC1, cv::Scalar(110));  // mean of four
  EXPECT_LE(
      largest_difference(image_in("bayer_rggb8; png compressed ", png_of(mosaic)), brightness), 1);
  EXPECT_LE(
      largest_difference(image_in("bayer_rggb8; jpeg compressed ", jpeg_of(mosaic)), brightness),
      3);
  EXPECT_EQ(
      largest_difference(image_in("bayer_rggb8; png compressed bgr8", png_of(mosaic)), mosaic), 0);
}

TEST(PackedImage, WhatIsDamagedOrSomethingElseIsRejected) {
  const Bytes jpeg = jpeg_of(slope(CV_8UC1)), png = png_of(slope(CV_8UC1));
  const auto first = [](const Bytes& file, std::size_t size) {
    return Bytes(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(size));
  };
  for (std::size_t size = 0; size + 2 < jpeg.size(); ++size)
    ASSERT_NE(rejected(first(jpeg, size)), "accepted") << size;
  for (std::size_t size = 0; size < png.size() / 2; ++size)
    ASSERT_NE(rejected(first(png, size)), "accepted") << size;
  EXPECT_EQ(rejected({}), "neither JPEG nor PNG");
  EXPECT_EQ(rejected({'G', 'I', 'F', '8', '9', 'a'}), "neither JPEG nor PNG");
  Bytes large = jpeg;  // a header that promises 32639 x 32639 pixels
  for (std::size_t i = 0; i + 8 < large.size(); ++i) {
    if (large[i] != 0xff || large[i + 1] != 0xc0) continue;
    std::fill_n(large.begin() + static_cast<std::ptrdiff_t>(i) + 5, 4, std::uint8_t{0x7f});
    break;
  }
  EXPECT_EQ(rejected(large), "image too large");
}

}  // namespace
}  // namespace covey
