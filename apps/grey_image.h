// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

namespace covey {

// 8-bit grey for the tracker. Images of 16 bits are stretched to what they hold, without the
// darkest and brightest half per cent: thermal cameras use a small part of their range.
[[nodiscard]] cv::Mat to_grey8(const cv::Mat& image);

}  // namespace covey
