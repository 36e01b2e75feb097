// SPDX-License-Identifier: Apache-2.0
#include "frontend/pixel_lag.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "frontend/image_pyramid.h"
#include "frontend/patch_alignment.h"
#include "tests/frontend/synthetic_lag.h"

namespace covey {
namespace {

cv::Mat without_lag(const cv::Mat& grey, const Eigen::Vector2d& velocity) {
  PixelLag lag(lagging_camera());
  lag.set_motion({}, moving(velocity));
  return lag.taken_out(grey, kLag_s);
}

// Of patches all over `before`, found again in `after` that shows the same scene: from where they
// should be, px.
double root_mean_square_error(const cv::Mat& before, const cv::Mat& after) {
  const ImagePyramid earlier = build_pyramid(before, 2), later = build_pyramid(after, 2);
  double sum = 0;
  int count = 0;
  for (int y = 40; y <= kHeight - 40; y += 20) {
    for (int x = 40; x <= kWidth - 40; x += 20) {
      const Eigen::Vector2d pixel(x, y);
      const auto patch = Patch::cut(earlier, pixel, {});
      if (!patch) continue;
      const auto found = patch->align(later, {pixel, Eigen::Matrix2d::Identity()}, 2, {});
      if (!found) continue;
      sum += (found->place.pixel - pixel).squaredNorm();
      ++count;
    }
  }
  EXPECT_GT(count, 100);
  return std::sqrt(sum / count);
}

TEST(PixelLag, ImageThatStandsStillIsNotTouched) {
  const cv::Mat grey = seen(scene(), {0, 0});
  EXPECT_EQ(cv::norm(without_lag(grey, {0, 0}), grey, cv::NORM_INF), 0);
}

TEST(PixelLag, PatchesAreWhereTheyAreAtWhateverSpeedTheyWereSeen) {
  const cv::Mat texture = scene(), at_rest = seen(texture, {0, 0});
  for (const Eigen::Vector2d& velocity :
       std::vector<Eigen::Vector2d>{{60, 10}, {-150, 40}, {90, 200}, {300, -100}, {0, -260}}) {
    const cv::Mat lagging = seen(texture, velocity);
    const double before = root_mean_square_error(at_rest, lagging);
    const double after = root_mean_square_error(at_rest, without_lag(lagging, velocity));
    EXPECT_LT(after, 0.08) << velocity.transpose();
    if (velocity.norm() > 100) {
      EXPECT_LT(6 * after, before) << velocity.transpose();
    }
  }
}

TEST(PixelLag, WrongSpeedMovesPatchesLittle) {
  const cv::Mat texture = scene(), at_rest = seen(texture, {0, 0});
  const Eigen::Vector2d velocity(200, 0);  // 1.6 px during the lag
  const cv::Mat sharp = without_lag(seen(texture, velocity), 1.05 * velocity);
  EXPECT_LT(root_mean_square_error(at_rest, sharp), 0.1);
}

// Of a flash of 40 px during the lag nothing is left to be tracked; nor does it reach beyond the
// image.
TEST(PixelLag, FarTooFastStaysInTheImage) {
  const Eigen::Vector2d velocity(4000, 3000);
  const cv::Mat sharp = without_lag(seen(scene(), velocity), velocity);
  EXPECT_EQ(sharp.size(), cv::Size(kWidth, kHeight));
  EXPECT_EQ(sharp.type(), CV_8UC1);
}

TEST(PixelLag, FlowIsThatOfAPointTheCameraTurnsAwayFrom) {
  PixelLag lag(lagging_camera());
  const Eigen::Vector3d rate(0.7, -0.4, 1.1);
  lag.set_motion({rate, Eigen::Vector3d::Zero()}, {});
  constexpr double kStep_s = 1e-5;
  const Eigen::Matrix3d R_later =
      Eigen::AngleAxisd(-rate.norm() * kStep_s, rate.normalized()).toRotationMatrix();
  for (const Eigen::Vector2d& pixel :
       std::vector<Eigen::Vector2d>{{64, 32}, {160, 128}, {256, 192}, {32, 192}}) {
    const Eigen::Vector2d bearing = *unproject(lagging_camera(), pixel);
    const Eigen::Vector3d ray = R_later * bearing.homogeneous();
    const Eigen::Vector2d numeric =
        (project(lagging_camera(), ray.hnormalized()) - pixel) / kStep_s;
    EXPECT_NEAR((lag.flow(pixel) - numeric).norm(), 0, 0.1) << pixel.transpose();
  }
}

TEST(PixelLag, FlowFollowsTheNearestTracks) {
  std::vector<TrackPlace> tracks = moving({100, 0});
  tracks.push_back(tracks[0]);
  tracks[1].place.pixel = {250, 160};
  tracks[1].velocity = {-50, 30};
  PixelLag lag(lagging_camera());
  lag.set_motion({}, tracks);
  EXPECT_NEAR((lag.flow({96, 96}) - tracks[0].velocity).norm(), 0, 2);
  EXPECT_NEAR((lag.flow({256, 160}) - tracks[1].velocity).norm(), 0, 2);
}

// S = I - tau v.grad I, moved back by tau v, of a pixel whose path is tau v, px.
double level_without_lag(const cv::Mat& grey, int x, int y, const Eigen::Vector2d& path) {
  const auto at = [&](int column, int row) {
    return static_cast<double>(grey.at<std::uint8_t>(row, column));
  };
  const auto sharp = [&](int column, int row) {
    const double along_x = (8 * (at(column + 1, row) - at(column - 1, row)) -
                            (at(column + 2, row) - at(column - 2, row))) /
                           12;
    const double along_y = (8 * (at(column, row + 1) - at(column, row - 1)) -
                            (at(column, row + 2) - at(column, row - 2))) /
                           12;
    return at(column, row) - path.dot(Eigen::Vector2d(along_x, along_y));
  };
  const Eigen::Vector2d from = Eigen::Vector2d(x, y) + path;
  const int left = static_cast<int>(std::floor(from.x()));
  const int top = static_cast<int>(std::floor(from.y()));
  const double fx = from.x() - left, fy = from.y() - top;
  const double above = (1 - fx) * sharp(left, top) + fx * sharp(left + 1, top);
  const double below = (1 - fx) * sharp(left, top + 1) + fx * sharp(left + 1, top + 1);
  return std::clamp((1 - fy) * above + fy * below, 0.0, 255.0);
}

// It is worked out in whole numbers of 16 bits.
TEST(PixelLag, EveryPixelIsRightToAGreyLevel) {
  const cv::Mat texture = scene();
  for (const Eigen::Vector2d& velocity :
       std::vector<Eigen::Vector2d>{{60, 10}, {-150, 40}, {300, -500}, {-1100, -900}}) {
    const cv::Mat lagging = seen(texture, velocity);
    const cv::Mat sharp = without_lag(lagging, velocity);
    double sum = 0, most = 0;
    int count = 0;
    for (int y = 20; y < kHeight - 20; ++y) {
      for (int x = 20; x < kWidth - 20; ++x) {
        const double wanted = level_without_lag(lagging, x, y, kLag_s * velocity);
        const double error = sharp.at<std::uint8_t>(y, x) - wanted;
        sum += error;
        most = std::max(most, std::abs(error));
        ++count;
      }
    }
    EXPECT_LT(most, 1) << velocity.transpose();
    EXPECT_LT(std::abs(sum / count), 0.1) << velocity.transpose();
  }
}

constexpr double kLineDelay_s = 6e-5;

// What a rolling shutter shows of a scene that moves at `velocity`, px/s; at the stamp, when the
// middle row looks, it lies where it lies at rest.
cv::Mat row_by_row(const cv::Mat& scene, const Eigen::Vector2d& velocity) {
  cv::Mat from_x(kHeight, kWidth, CV_32FC1), from_y(kHeight, kWidth, CV_32FC1), image, grey;
  for (int y = 0; y < kHeight; ++y) {
    const Eigen::Vector2d moved = kLineDelay_s * (y - 0.5 * (kHeight - 1)) * velocity;
    for (int x = 0; x < kWidth; ++x) {
      from_x.at<float>(y, x) = static_cast<float>(x + kWidth / 2 - moved.x());
      from_y.at<float>(y, x) = static_cast<float>(y + kHeight / 2 - moved.y());
    }
  }
  cv::remap(scene, image, from_x, from_y, cv::INTER_CUBIC);
  image.convertTo(grey, CV_8UC1);
  return grey;
}

TEST(PixelLag, RowsOfARollingShutterAreBroughtToTheStamp) {
  const cv::Mat texture = scene(), at_once = row_by_row(texture, {0, 0});
  for (const Eigen::Vector2d& velocity :
       std::vector<Eigen::Vector2d>{{200, 0}, {-300, 150}, {0, 400}, {40, -350}}) {
    PixelLag rows(lagging_camera(), kLineDelay_s);
    rows.set_motion({}, moving(velocity));
    const cv::Mat rolled = row_by_row(texture, velocity);
    const double before = root_mean_square_error(at_once, rolled);
    const double after = root_mean_square_error(at_once, rows.taken_out(rolled, 0));
    EXPECT_LT(after, 0.08) << velocity.transpose();
    EXPECT_GT(before, 0.6) << velocity.transpose();
  }
}

TEST(PixelLag, FlowOfARowIsThatUntilItLooks) {
  PixelLag rows(lagging_camera(), kLineDelay_s);
  const Turn turn{{0.07, -0.04, 0.11}, {7, -4, 11}};
  rows.set_motion(turn, {});
  for (const Eigen::Vector2d& pixel : std::vector<Eigen::Vector2d>{{64, 32}, {256, 192}}) {
    const double later_s = kLineDelay_s * (pixel.y() - 0.5 * (kHeight - 1));
    const Eigen::Vector3d turned =
        later_s * turn.rate + 0.5 * later_s * later_s * turn.acceleration;
    const Eigen::Matrix3d R_later =
        Eigen::AngleAxisd(-turned.norm(), turned.normalized()).toRotationMatrix();
    const Eigen::Vector3d ray = R_later * unproject(lagging_camera(), pixel)->homogeneous();
    const Eigen::Vector2d numeric =
        (project(lagging_camera(), ray.hnormalized()) - pixel) / later_s;
    EXPECT_NEAR((rows.flow(pixel) - numeric).norm(), 0, 0.2) << pixel.transpose();
  }
}

TEST(PixelLag, ATrackThatMovesOtherwiseSaysHowFarItWasTakenTooFar) {
  PixelLag rows(lagging_camera(), kLineDelay_s);
  rows.set_motion({}, moving({100, 0}));
  TrackPlace near;
  near.place.pixel = {200, 0.5 * (kHeight - 1) + 100};
  near.velocity = {160, -20};
  const Eigen::Vector2d expected = 100 * kLineDelay_s * Eigen::Vector2d(60, -20);
  EXPECT_NEAR((rows.taken_too_far(near) - expected).norm(), 0, 1e-6);
  PixelLag at_once(lagging_camera());
  at_once.set_motion({}, moving({100, 0}));
  EXPECT_EQ(at_once.taken_too_far(near).norm(), 0);
}

}  // namespace
}  // namespace covey
