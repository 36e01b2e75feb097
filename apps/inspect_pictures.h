// SPDX-License-Identifier: Apache-2.0
//
// The pictures of `covey inspect`. Colours are CV_8UC3, red first, as write_png takes them.
#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>

#include "apps/inspection.h"

namespace covey {

// Images of one height, with a gap between them.
[[nodiscard]] cv::Mat side_by_side(const cv::Mat& left, const cv::Mat& right);

// The paper's colours: blue SLAM tracks, orange MSCKF tracks, purple opportunistic ones. What
// `mask` (Dataset's, may be empty) leaves out is red.
[[nodiscard]] cv::Mat draw_tracks(const Picture& picture, const cv::Mat& mask);

// CV_32FC1, from -range (dark blue) to range (yellow), `size` large.
[[nodiscard]] cv::Mat draw_field(const cv::Mat& field, double range, cv::Size size);

}  // namespace covey
