// SPDX-License-Identifier: Apache-2.0
#include "apps/flight_pictures.h"

#include <opencv2/imgproc.hpp>
#include <utility>

#include "apps/inspect_pictures.h"
#include "apps/png_file.h"
#include "apps/run_files.h"

namespace covey {
namespace {

constexpr int kMoments = 3;
constexpr int kWidth_px = 1000;  // of raw, calibrated and tracks together: a page shows no more

cv::Mat in_colour(const cv::Mat& grey) {
  cv::Mat colour;
  cv::cvtColor(grey, colour, cv::COLOR_GRAY2RGB);
  return colour;
}

cv::Mat draw_moment(const cv::Mat& raw, const Picture& calibrated, const cv::Mat& mask) {
  const cv::Mat row = side_by_side(side_by_side(in_colour(raw), in_colour(calibrated.grey)),
                                   draw_tracks(calibrated, mask));
  cv::Mat small;
  cv::resize(row, small, {kWidth_px, kWidth_px * row.rows / row.cols}, 0, 0, cv::INTER_AREA);
  return small;
}

}  // namespace

FlightPictures::FlightPictures(const std::vector<ImageEntry>& images) {
  if (images.empty()) return;
  for (const std::size_t index : picture_indices(images.size(), kMoments))
    stamps_.push_back(images[index].stamp_ns);
}

bool FlightPictures::is_due(TimeNs stamp_ns) const {
  return moments_.size() < stamps_.size() && stamp_ns >= stamps_[moments_.size()];
}

void FlightPictures::add(cv::Mat raw, Picture calibrated) {
  moments_.push_back({std::move(raw), std::move(calibrated)});
}

void FlightPictures::write(const std::filesystem::path& folder, const cv::Mat& mask) const {
  if (moments_.empty()) return;
  std::vector<cv::Mat> rows;
  CornerHistogram raw, calibrated;
  for (const Moment& moment : moments_) {
    rows.push_back(draw_moment(moment.raw, moment.calibrated, mask));
    raw.add(moment.raw);
    calibrated.add(moment.calibrated.grey);
  }
  cv::Mat sheet;
  cv::vconcat(rows, sheet);
  write_png((folder / kPicturesFile).string(), sheet);
  write_corners(folder, corner_records(raw, calibrated));
}

}  // namespace covey
