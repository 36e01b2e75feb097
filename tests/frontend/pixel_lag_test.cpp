// SPDX-License-Identifier: Apache-2.0
#include "frontend/pixel_lag.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "frontend/image_pyramid.h"
#include "frontend/patch_alignment.h"

namespace covey {
namespace {

constexpr double kLag_s = 0.008;
constexpr int kWidth = 320, kHeight = 240;

CameraIntrinsics camera() {
  return {kWidth,
          kHeight,
          180,
          185,
          158,
          121,
          DistortionModel::kRadialTangential,
          {-0.2, 0.05, 0.001, -0.002}};
}

// Fine and coarse texture, larger than the image.
cv::Mat scene() {
  cv::Mat white(2 * kHeight, 2 * kWidth, CV_32FC1), fine, coarse;
  cv::RNG random(7);
  random.fill(white, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(white, fine, {}, 1.3);
  cv::GaussianBlur(white, coarse, {}, 5);
  return 128 + 110 * fine + 430 * coarse;
}

// What pixels that lag show of a scene that moves at `velocity`, px/s, and that lies at `offset`
// one time constant before they are read out, the moment of the stamp.
cv::Mat seen(const cv::Mat& scene, const Eigen::Vector2d& velocity,
             const Eigen::Vector2d& offset = Eigen::Vector2d::Zero()) {
  constexpr int kInstants = 150;
  constexpr double kReach = 7;  // time constants
  cv::Mat sum = cv::Mat::zeros(kHeight, kWidth, CV_32FC1);
  double total = 0;
  for (int i = 0; i < kInstants; ++i) {
    const double ago = (i + 0.5) / kInstants * kReach;
    const Eigen::Vector2d from =
        Eigen::Vector2d(kWidth / 2, kHeight / 2) - offset + kLag_s * (ago - 1) * velocity;
    const cv::Matx23d to_scene(1, 0, from.x(), 0, 1, from.y());
    cv::Mat instant;
    cv::warpAffine(scene, instant, to_scene, sum.size(), cv::INTER_CUBIC | cv::WARP_INVERSE_MAP);
    sum += std::exp(-ago) * instant;
    total += std::exp(-ago);
  }
  cv::Mat grey;
  sum.convertTo(grey, CV_8UC1, 1 / total);
  return grey;
}

// One track that all of the image moves with.
std::vector<TrackPlace> moving(const Eigen::Vector2d& velocity) {
  TrackPlace track;
  track.place.pixel = {100, 100};
  track.velocity = velocity;
  return {track};
}

cv::Mat without_lag(const cv::Mat& grey, const Eigen::Vector2d& velocity) {
  PixelLag lag(camera(), kLag_s);
  lag.set_motion(Eigen::Vector3d::Zero(), moving(velocity));
  return lag.taken_out(grey);
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

// What moves faster than any path that is taken out is found no worse than it was.
TEST(PixelLag, FarTooFastIsNoWorseThanBefore) {
  const cv::Mat texture = scene();
  const Eigen::Vector2d velocity(4000, 3000);
  const cv::Mat sharp = without_lag(seen(texture, velocity), velocity);
  EXPECT_EQ(sharp.size(), cv::Size(kWidth, kHeight));
}

TEST(PixelLag, PathIsThatOfAPointTheCameraTurnsAwayFrom) {
  PixelLag lag(camera(), kLag_s);
  const Eigen::Vector3d rate(0.7, -0.4, 1.1);
  lag.set_motion(rate, {});
  constexpr double kStep_s = 1e-5;
  const Eigen::Matrix3d R_later =
      Eigen::AngleAxisd(-rate.norm() * kStep_s, rate.normalized()).toRotationMatrix();
  for (const Eigen::Vector2d& pixel :
       std::vector<Eigen::Vector2d>{{64, 32}, {160, 128}, {256, 192}, {32, 192}}) {
    const Eigen::Vector2d bearing = *unproject(camera(), pixel);
    const Eigen::Vector3d ray = R_later * bearing.homogeneous();
    const Eigen::Vector2d numeric =
        kLag_s * (project(camera(), ray.hnormalized()) - pixel) / kStep_s;
    EXPECT_NEAR((lag.path(pixel) - numeric).norm(), 0, 1e-3) << pixel.transpose();
  }
}

TEST(PixelLag, PathFollowsTheNearestTracks) {
  std::vector<TrackPlace> tracks = moving({100, 0});
  tracks.push_back(tracks[0]);
  tracks[1].place.pixel = {250, 160};
  tracks[1].velocity = {-50, 30};
  PixelLag lag(camera(), kLag_s);
  lag.set_motion(Eigen::Vector3d::Zero(), tracks);
  EXPECT_NEAR((lag.path({96, 96}) - kLag_s * tracks[0].velocity).norm(), 0, 0.02);
  EXPECT_NEAR((lag.path({256, 160}) - kLag_s * tracks[1].velocity).norm(), 0, 0.02);
}

}  // namespace
}  // namespace covey
