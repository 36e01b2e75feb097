// SPDX-License-Identifier: Apache-2.0
#include "apps/png_file.h"

#include <spng.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <memory>
#include <opencv2/imgproc.hpp>
#include <stdexcept>
#include <vector>

namespace covey {
namespace {

// A hostile header must not make us allocate the memory of the whole machine.
constexpr std::uint32_t kMaxSide = 16384;                    // pixels
constexpr std::size_t kMaxFileBytes = std::size_t{1} << 28;  // 256 MiB

struct CloseFile {
  void operator()(std::FILE* file) const { std::fclose(file); }
};
using File = std::unique_ptr<std::FILE, CloseFile>;
using Context = std::unique_ptr<spng_ctx, void (*)(spng_ctx*)>;

[[noreturn]] void fail(const std::string& path, const std::string& what) {
  throw std::runtime_error(path + ": " + what);
}

void check(int error, const std::string& path, const char* what) {
  if (error != 0) fail(path, std::string(what) + ": " + spng_strerror(error));
}

std::vector<std::uint8_t> read_bytes(const std::string& path) {
  const File file(std::fopen(path.c_str(), "rb"));
  if (!file) fail(path, std::string("cannot open image: ") + std::strerror(errno));
  std::vector<std::uint8_t> bytes;
  std::uint8_t chunk[65536];
  std::size_t n = 0;
  while ((n = std::fread(chunk, 1, sizeof chunk, file.get())) > 0) {
    bytes.insert(bytes.end(), chunk, chunk + n);
    if (bytes.size() > kMaxFileBytes) fail(path, "image file is larger than 256 MiB");
  }
  if (std::ferror(file.get())) fail(path, "cannot read image");
  if (bytes.empty()) fail(path, "image file is empty");
  return bytes;
}

spng_ihdr read_header(spng_ctx* context, const std::string& path) {
  spng_ihdr header{};
  check(spng_get_ihdr(context, &header), path, "not a readable PNG image");
  if (header.width > kMaxSide || header.height > kMaxSide) fail(path, "image is too large");
  return header;
}

// Grey files keep their depth; everything else is decoded to RGB and reduced to grey.
cv::Mat decode(spng_ctx* context, const spng_ihdr& header, const std::string& path) {
  const bool grey = header.color_type == SPNG_COLOR_TYPE_GRAYSCALE;
  const bool deep = grey && header.bit_depth == 16;
  const int type = grey ? (deep ? CV_16UC1 : CV_8UC1) : CV_8UC3;
  const spng_format format = grey ? (deep ? SPNG_FMT_PNG : SPNG_FMT_G8) : SPNG_FMT_RGB8;
  cv::Mat image(static_cast<int>(header.height), static_cast<int>(header.width), type);
  const std::size_t size = image.total() * image.elemSize();
  check(spng_decode_image(context, image.data, size, format, 0), path,
        "image is damaged or cut short");
  if (grey) return image;
  cv::Mat luma;
  cv::cvtColor(image, luma, cv::COLOR_RGB2GRAY);
  return luma;
}

}  // namespace

cv::Mat read_png(const std::string& path) { return decode_png(read_bytes(path), path); }

cv::Mat decode_png(const std::vector<std::uint8_t>& file, const std::string& name) {
  const Context context(spng_ctx_new(0), spng_ctx_free);
  if (!context) fail(name, "out of memory");
  check(spng_set_image_limits(context.get(), kMaxSide, kMaxSide), name, "image limits");
  check(spng_set_png_buffer(context.get(), file.data(), file.size()), name, "image buffer");
  return decode(context.get(), read_header(context.get(), name), name);
}

void write_png(const std::string& path, const cv::Mat& image) {
  const bool colour = image.type() == CV_8UC3;
  if (image.empty() || (!colour && image.type() != CV_8UC1 && image.type() != CV_16UC1))
    fail(path, "only grey images of 8 and 16 bits and RGB images can be written");
  const cv::Mat packed = image.isContinuous() ? image : image.clone();
  File file(std::fopen(path.c_str(), "wb"));
  if (!file) fail(path, std::string("cannot create image: ") + std::strerror(errno));

  const Context context(spng_ctx_new(SPNG_CTX_ENCODER), spng_ctx_free);
  if (!context) fail(path, "out of memory");
  spng_ihdr header{};
  header.width = static_cast<std::uint32_t>(packed.cols);
  header.height = static_cast<std::uint32_t>(packed.rows);
  header.bit_depth = packed.type() == CV_16UC1 ? 16 : 8;
  header.color_type = colour ? SPNG_COLOR_TYPE_TRUECOLOR : SPNG_COLOR_TYPE_GRAYSCALE;
  check(spng_set_ihdr(context.get(), &header), path, "image header");
  check(spng_set_option(context.get(), SPNG_IMG_COMPRESSION_LEVEL, 1), path, "compression level");
  // One fixed filter: choosing per line costs more time than it saves bytes on noisy images.
  check(spng_set_option(context.get(), SPNG_FILTER_CHOICE, SPNG_FILTER_CHOICE_SUB), path, "filter");
  check(spng_set_png_file(context.get(), file.get()), path, "image file");
  check(spng_encode_image(context.get(), packed.data, packed.total() * packed.elemSize(),
                          SPNG_FMT_PNG, SPNG_ENCODE_FINALIZE),
        path, "cannot write image");
  if (std::fclose(file.release()) != 0)
    fail(path, std::string("cannot write image: ") + std::strerror(errno));
}

}  // namespace covey
