// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fstream>
#include <iterator>
#include <opencv2/core/mat.hpp>
#include <string>

#include "apps/png_file.h"
#include "comms/convert.h"
#include "tests/apps/temporary_folder.h"

namespace covey {

// What write_png() makes of it.
inline Bytes png_of(const cv::Mat& image) {
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "image.png").string();
  write_png(file, image);
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace covey
