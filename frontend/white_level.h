// SPDX-License-Identifier: Apache-2.0
//
// The grey level at which a sensor saturates. An image of 16 bits may come from a sensor of fewer,
// with its bits at the lower or the upper end, or be cut off anywhere: its brightest pixels tell.
#pragma once

#include <opencv2/core.hpp>

namespace covey {

// `image`: CV_8UC1 or CV_16UC1. The largest value of so many bits wherever a pixel has it; any
// other largest value where the image is cut off there: a share `cut_off_share` of the pixels has
// it, and hardly any have the next one below.
[[nodiscard]] int white_level(const cv::Mat& image, double cut_off_share = 0.005);

}  // namespace covey
