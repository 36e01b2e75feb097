// SPDX-License-Identifier: Apache-2.0
#include "apps/flight_pictures.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

#include "apps/png_file.h"
#include "apps/run_files.h"
#include "apps/team_summary.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

// One at each of the nanoseconds from 0 on.
std::vector<ImageEntry> images(TimeNs count) {
  std::vector<ImageEntry> images;
  for (TimeNs stamp_ns = 0; stamp_ns < count; ++stamp_ns) images.push_back({stamp_ns, ""});
  return images;
}

cv::Mat chessboard(double contrast) {
  cv::Mat image(256, 320, CV_8UC1, cv::Scalar(100));
  for (int y = 0; y < image.rows; y += 16) {
    for (int x = y % 32; x < image.cols; x += 32) image(cv::Rect(x, y, 16, 16)) = 100 + contrast;
  }
  return image;
}

Picture picture_at(TimeNs stamp_ns) {
  return {stamp_ns, chessboard(100), {{{60, 60}, TrackKind::kSlam}}};
}

TEST(FlightPictures, AreOfMomentsSpreadOverTheFlight) {
  FlightPictures pictures(images(40));
  std::vector<TimeNs> pictured;
  for (TimeNs stamp_ns = 0; stamp_ns < 40; ++stamp_ns) {
    if (stamp_ns >= 18 && stamp_ns < 24) continue;  // the camera sees nothing, or images are late
    if (!pictures.is_due(stamp_ns)) continue;
    pictures.add(chessboard(10), picture_at(stamp_ns));
    pictured.push_back(stamp_ns);
  }
  EXPECT_EQ(pictured, (std::vector<TimeNs>{10, 24, 30}));
}

TEST(FlightPictures, OfALiveFlightThereAreNone) {
  const TemporaryFolder folder;
  const FlightPictures pictures({});
  EXPECT_FALSE(pictures.is_due(1'000'000'000));
  pictures.write(folder.path(), cv::Mat());
  EXPECT_TRUE(fs::is_empty(folder.path()));
}

TEST(FlightPictures, ShowEachMomentRawCalibratedAndWithTracksAndHowStrongCornersAre) {
  const TemporaryFolder folder;
  FlightPictures pictures(images(40));
  for (const TimeNs stamp_ns : {10, 20}) pictures.add(chessboard(10), picture_at(stamp_ns));
  pictures.write(folder.path(), cv::Mat());
  const cv::Mat sheet = read_png((folder.path() / kPicturesFile).string());
  EXPECT_EQ(sheet.cols, 1000);
  EXPECT_NEAR(sheet.rows, 2 * 256 * 1000 / (3 * 320 + 16), 2);
  const auto contrast = [&](int from, int to) {
    double least = 0, most = 0;
    cv::minMaxLoc(sheet.colRange(from, to), &least, &most);
    return most - least;
  };
  EXPECT_LT(contrast(0, 300), 15) << "raw";
  EXPECT_GT(contrast(340, 640), 90) << "calibrated";
  const std::vector<CornerRecord> corners = read_corners(folder.path() / kCornersFile);
  const auto strongest = [&](double CornerRecord::*share) {
    double response = -9;
    for (const CornerRecord& corner : corners)
      if (corner.*share > 0) response = corner.log10_response;
    return response;
  };
  EXPECT_NEAR(strongest(&CornerRecord::calibrated) - strongest(&CornerRecord::raw), 4, 0.21)
      << "ten times the contrast, ten thousand times the response";
}

// What a killed drone wrote is cut to whole lines; a picture has none.
TEST(FlightPictures, StayWholeWhereIncompleteLinesAreDropped) {
  const TemporaryFolder folder;
  const fs::path picture = folder.path() / kPicturesFile;
  write_png(picture.string(), chessboard(50));
  const auto size = fs::file_size(picture);
  folder.write(kCornersFile, "log10_response,raw,calibrated\n-8.9,0.2");
  drop_incomplete_lines(folder.path());
  EXPECT_EQ(fs::file_size(picture), size);
  EXPECT_TRUE(read_corners(folder.path() / kCornersFile).empty());
}

}  // namespace
}  // namespace covey
