// SPDX-License-Identifier: Apache-2.0
#include "apps/packed_image.h"

#include <turbojpeg.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <opencv2/core/mat.hpp>
#include <stdexcept>
#include <string>
#include <utility>

#include "apps/camera_pixels.h"
#include "apps/png_file.h"

namespace covey {
namespace {

constexpr std::array<std::uint8_t, 3> kJpegBegin{0xff, 0xd8, 0xff};
constexpr std::array<std::uint8_t, 4> kPngBegin{0x89, 'P', 'N', 'G'};

template <std::size_t size>
bool begins_with(const Bytes& file, const std::array<std::uint8_t, size>& begin) {
  return file.size() >= size && std::equal(begin.begin(), begin.end(), file.begin());
}

// "bayer_rggb8; jpeg compressed ": a mosaic was packed as if it were grey. With "bgr8" in the end
// it had been made colours before.
bool holds_mosaic(const std::string& format) {
  return format.rfind("bayer_", 0) == 0 && format.find("; ") != std::string::npos &&
         format.find(" bgr") == std::string::npos;
}

Decoded<CameraImage> with_mosaic_resolved(CameraImage image, const std::string& format) {
  if (image.bytes_per_pixel != 1 || !holds_mosaic(format)) return image;
  const auto width = static_cast<std::uint32_t>(image.width);
  return checked(RosImage{image.stamp_ns, width, static_cast<std::uint32_t>(image.height), width,
                          format.substr(0, format.find(';')), false, std::move(image.pixels)});
}

Decoded<CameraImage> unpacked_jpeg(const PackedImage& packed) {
  using Decompressor = std::unique_ptr<void, int (*)(tjhandle)>;
  const Decompressor jpeg(tjInitDecompress(), tjDestroy);
  if (!jpeg) return Rejected{"out of memory"};
  const auto size = static_cast<unsigned long>(packed.file.size());
  CameraImage image;
  image.stamp_ns = packed.stamp_ns;
  int sampling = 0, colours = 0;
  if (tjDecompressHeader3(jpeg.get(), packed.file.data(), size, &image.width, &image.height,
                          &sampling, &colours) != 0)
    return Rejected{"JPEG that cannot be read"};
  const auto pixels =
      static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height);
  if (pixels > kMaxImageBytes) return Rejected{"image too large"};
  image.pixels.resize(pixels);
  if (tjDecompress2(jpeg.get(), packed.file.data(), size, image.pixels.data(), image.width, 0,
                    image.height, TJPF_GRAY, 0) != 0)
    return Rejected{"JPEG that is damaged or cut short"};
  return with_mosaic_resolved(std::move(image), packed.format);
}

Decoded<CameraImage> unpacked_png(const PackedImage& packed) {
  try {
    const cv::Mat pixels = decode_png(packed.file, "PNG");
    return with_mosaic_resolved(to_camera_image(packed.stamp_ns, pixels), packed.format);
  } catch (const std::runtime_error& error) {
    return Rejected{error.what()};
  }
}

}  // namespace

Decoded<CameraImage> unpacked(const PackedImage& image) {
  if (begins_with(image.file, kJpegBegin)) return unpacked_jpeg(image);
  if (begins_with(image.file, kPngBegin)) return unpacked_png(image);
  return Rejected{"neither JPEG nor PNG"};
}

}  // namespace covey
