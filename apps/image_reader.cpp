// SPDX-License-Identifier: Apache-2.0
#include "apps/image_reader.h"

#include <spdlog/spdlog.h>

#include <stdexcept>

namespace covey {

std::optional<cv::Mat> ImageReader::read(const ImageEntry& image) {
  try {
    return read_image(image, width_, height_);
  } catch (const std::runtime_error& error) {
    if (left_out_++ == 0)
      spdlog::warn("{}: left out, as are others that cannot be read", error.what());
    return std::nullopt;
  }
}

}  // namespace covey
