// SPDX-License-Identifier: Apache-2.0
#include "apps/inspect_pictures.h"

#include <cmath>
#include <opencv2/imgproc.hpp>

namespace covey {
namespace {

constexpr int kGap = 8;  // px between two images

cv::Scalar color_of(TrackKind kind) {
  switch (kind) {
    case TrackKind::kSlam:
      return {40, 120, 255};
    case TrackKind::kMsckf:
      return {255, 150, 20};
    case TrackKind::kOpportunistic:
      break;
  }
  return {190, 70, 230};
}

}  // namespace

cv::Mat side_by_side(const cv::Mat& left, const cv::Mat& right) {
  cv::Mat pair(left.rows, left.cols + kGap + right.cols, left.type(), cv::Scalar::all(255));
  left.copyTo(pair.colRange(0, left.cols));
  right.copyTo(pair.colRange(left.cols + kGap, pair.cols));
  return pair;
}

cv::Mat draw_tracks(const Picture& picture, const cv::Mat& mask) {
  constexpr int kRadius = 4, kShift = 4, kWidth = 2;  // px; binary digits of a fraction; px
  constexpr double kOne = 1 << kShift;
  cv::Mat drawing;
  cv::cvtColor(picture.grey, drawing, cv::COLOR_GRAY2RGB);
  if (!mask.empty()) {
    cv::Mat red;
    cv::addWeighted(drawing, 0.4, cv::Mat(drawing.size(), CV_8UC3, cv::Scalar(200, 0, 0)), 0.6, 0,
                    red);
    red.copyTo(drawing, mask == 0);
  }
  for (const DrawnTrack& track : picture.tracks) {
    const cv::Point centre(static_cast<int>(std::lround(track.pixel.x() * kOne)),
                           static_cast<int>(std::lround(track.pixel.y() * kOne)));
    cv::circle(drawing, centre, kRadius << kShift, color_of(track.kind), kWidth, cv::LINE_AA,
               kShift);
  }
  return drawing;
}

cv::Mat draw_field(const cv::Mat& field, double range, cv::Size size) {
  constexpr double kMiddle = 127.5;
  cv::Mat large, grey, drawing;
  cv::resize(field, large, size, 0, 0, cv::INTER_LINEAR);
  large.convertTo(grey, CV_8U, kMiddle / range, kMiddle);
  cv::applyColorMap(grey, drawing, cv::COLORMAP_VIRIDIS);
  cv::cvtColor(drawing, drawing, cv::COLOR_BGR2RGB);
  return drawing;
}

}  // namespace covey
