// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core.hpp>

namespace covey {

// CV_32FC1 without the plane that fits it best: x and y are orthogonal on a grid.
[[nodiscard]] inline cv::Mat without_slope(const cv::Mat& field) {
  cv::Mat x(field.size(), CV_32FC1), y(field.size(), CV_32FC1);
  for (int row = 0; row < field.rows; ++row) {
    for (int column = 0; column < field.cols; ++column) {
      x.at<float>(row, column) = static_cast<float>(column - 0.5 * (field.cols - 1));
      y.at<float>(row, column) = static_cast<float>(row - 0.5 * (field.rows - 1));
    }
  }
  cv::Mat rest = field - cv::mean(field)[0];
  rest -= x * (rest.dot(x) / x.dot(x));
  rest -= y * (rest.dot(y) / y.dot(y));
  return rest;
}

}  // namespace covey
