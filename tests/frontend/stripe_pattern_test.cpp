// SPDX-License-Identifier: Apache-2.0
#include "frontend/stripe_pattern.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

namespace covey {
namespace {

constexpr int kWidth = 320, kHeight = 256;  // px
const cv::Size kImage(kWidth, kHeight);

// A camera that moves over a warm plane of smooth texture; levels.
class Scene {
 public:
  explicit Scene(unsigned seed) : random_(seed), plane_(800, 800, CV_32F) {
    cv::Mat cells(40, 40, CV_32F);
    random_.fill(cells, cv::RNG::NORMAL, 0, kContrast);
    cv::resize(cells, plane_, plane_.size(), 0, 0, cv::INTER_CUBIC);
  }

  // Each column and row off by a number of its own.
  void stripe(double column_sigma, double row_sigma) {
    cv::Mat columns(1, kWidth, CV_32F), rows(kHeight, 1, CV_32F);
    random_.fill(columns, cv::RNG::NORMAL, 0, column_sigma);
    random_.fill(rows, cv::RNG::NORMAL, 0, row_sigma);
    stripes = cv::repeat(columns, kHeight, 1) + cv::repeat(rows, 1, kWidth);
  }

  [[nodiscard]] cv::Mat next() {
    const cv::Rect view({random_.uniform(0, 800 - kWidth), random_.uniform(0, 800 - kHeight)},
                        kImage);
    cv::Mat image = plane_(view) + stripes, grain(kImage, CV_32F);
    random_.fill(grain, cv::RNG::NORMAL, 0, kNoise);
    image += grain;
    if (horizon) image.rowRange(kHeight / 2, kHeight) += 600;
    cv::Mat levels;
    image.convertTo(levels, CV_16S);
    if (saturated_half) levels.colRange(0, kWidth / 2).rowRange(0, 90) = StripePattern::kNoLevel;
    return levels;
  }

  cv::Mat stripes = cv::Mat::zeros(kImage, CV_32F);
  bool horizon = false, saturated_half = false;

 private:
  static constexpr double kContrast = 100, kNoise = 3;
  cv::RNG random_;
  cv::Mat plane_;
};

cv::Mat found_after(int looks, Scene& scene, StripePattern& pattern) {
  for (int i = 0; i < looks; ++i) pattern.look(scene.next());
  cv::Mat found = cv::Mat::zeros(kImage, CV_16S), result;
  pattern.add_to(found);
  found.convertTo(result, CV_32F);
  return result;
}

double rms(const cv::Mat& image) {
  return cv::norm(image) / std::sqrt(static_cast<double>(image.total()));
}

// Without what is wider than a stripe: the mean of as many as the pattern takes for the scene's.
cv::Mat narrow(const cv::Mat& stripes) {
  cv::Mat wide_x, wide_y, columns, rows;
  cv::reduce(stripes, columns, 0, cv::REDUCE_AVG);
  cv::reduce(stripes, rows, 1, cv::REDUCE_AVG);
  cv::blur(columns, wide_x, {StripeConfig().window_px, 1}, {-1, -1}, cv::BORDER_REFLECT_101);
  cv::blur(rows, wide_y, {1, StripeConfig().window_px}, {-1, -1}, cv::BORDER_REFLECT_101);
  return cv::repeat(columns - wide_x, kHeight, 1) + cv::repeat(rows - wide_y, 1, kWidth);
}

cv::Mat inner(const cv::Mat& image) {
  const int border = StripeConfig().window_px / 2;
  return image(cv::Rect(border, border, kWidth - 2 * border, kHeight - 2 * border));
}

TEST(StripePattern, IsFoundWhileTheSceneMovesOn) {
  Scene scene(1);
  scene.stripe(4, 3);
  StripePattern pattern({}, kImage);
  const cv::Mat found = found_after(60, scene, pattern);
  const cv::Mat wanted = narrow(scene.stripes);
  EXPECT_LT(rms(inner(found - wanted)), 0.35 * rms(inner(wanted)));
}

TEST(StripePattern, IsHardlyThereWhereThereIsNone) {
  Scene scene(2);
  StripePattern pattern({}, kImage);
  EXPECT_LT(rms(found_after(60, scene, pattern)), 1.5) << "levels, half of a pixel's noise";
}

TEST(StripePattern, AnEdgeThatStandsStillIsNoStripe) {
  Scene scene(3);
  scene.horizon = true;
  StripePattern pattern({}, kImage);
  const cv::Mat found = found_after(60, scene, pattern);
  EXPECT_LT(cv::norm(found, cv::NORM_INF), 8) << "levels; the edge has 600";
}

TEST(StripePattern, PixelsWithoutALevelDoNotCount) {
  Scene scene(4);
  scene.stripe(4, 3);
  scene.saturated_half = true;
  StripePattern pattern({}, kImage);
  const cv::Mat found = found_after(100, scene, pattern);
  const cv::Mat wanted = narrow(scene.stripes);
  EXPECT_LT(rms(inner(found - wanted)), 0.5 * rms(inner(wanted)));
}

TEST(StripePattern, NothingSeenNothingFound) {
  const StripePattern pattern({}, kImage);
  cv::Mat image = cv::Mat::zeros(kImage, CV_16S);
  pattern.add_to(image);
  EXPECT_EQ(cv::countNonZero(image), 0);
  StripePattern blind({}, kImage);
  blind.look(cv::Mat(kImage, CV_16S, cv::Scalar(StripePattern::kNoLevel)));
  blind.add_to(image);
  EXPECT_EQ(cv::countNonZero(image), 0);
}

TEST(StripePattern, IsScaledWithTheLevels) {
  Scene scene(6);
  scene.stripe(8, 6);
  StripePattern pattern({}, kImage);
  const cv::Mat found = found_after(60, scene, pattern);
  pattern.scale(3);
  EXPECT_LE(cv::norm(found_after(0, scene, pattern), 3 * found, cv::NORM_INF), 3) << "roundings";
}

TEST(StripePattern, GivesWayToAnotherSoonerOnceDoubted) {
  const auto left_after = [](bool doubted) {
    Scene scene(5);
    scene.stripe(4, 3);
    StripePattern pattern({}, kImage);
    (void)found_after(100, scene, pattern);
    if (doubted) pattern.doubt();
    scene.stripe(4, 3);
    const cv::Mat found = found_after(20, scene, pattern);
    return rms(inner(found - narrow(scene.stripes)));
  };
  EXPECT_LT(left_after(true), 0.7 * left_after(false));
}

}  // namespace
}  // namespace covey
