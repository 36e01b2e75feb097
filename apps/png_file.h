// SPDX-License-Identifier: Apache-2.0
//
// PNG files through libspng. OpenCV's own codecs are not linked: they drag in GDAL, and with
// it tens of megabytes per process.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

namespace covey {

// CV_8UC1 or CV_16UC1, as the file is; colour files become 8-bit grey (ITU-R BT.601 luma).
// Throws std::runtime_error naming the file and what is wrong with it.
[[nodiscard]] cv::Mat read_png(const std::string& path);
// The same of a file that is in memory; errors name it `name`.
[[nodiscard]] cv::Mat decode_png(const std::vector<std::uint8_t>& file, const std::string& name);

// Writes CV_8UC1, CV_16UC1 or CV_8UC3 (red first) with a fast compression level: datasets are large
// and short-lived. Throws std::runtime_error naming the file when it cannot be written whole.
void write_png(const std::string& path, const cv::Mat& image);

}  // namespace covey
