// SPDX-License-Identifier: Apache-2.0
#include "sim/visual_camera.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

namespace covey {
namespace {

const CameraIntrinsics kCamera{
    320, 240, 200, 200, 159.5, 119.5, DistortionModel::kRadialTangential, {0, 0, 0, 0}};

cv::Mat flat_light(double radiance) { return {240, 320, CV_32FC1, cv::Scalar(radiance)}; }

double mean_level(const cv::Mat& image) { return cv::mean(image)[0]; }

TEST(VisualCamera, ExposureFollowsAChangeOfLightSlowly) {
  const VisualSensor sensor;
  VisualCamera camera(kCamera, sensor, 1);
  const double settled = mean_level(camera.expose(flat_light(0.5), 0));
  EXPECT_NEAR(settled, sensor.target_level, 0.25 * sensor.target_level);
  const double at_once = mean_level(camera.expose(flat_light(0.25), 1.0 / 30));
  EXPECT_LT(at_once, 0.6 * settled);
  double later = 0;
  for (int k = 0; k < 60; ++k) later = mean_level(camera.expose(flat_light(0.25), 1.0 / 30));
  EXPECT_GT(later, 0.9 * settled);
}

TEST(VisualCamera, CornersAreDarkerThanTheMiddle) {
  VisualCamera camera(kCamera, {}, 1);
  const cv::Mat image = camera.expose(flat_light(0.5), 0);
  const double middle = mean_level(image(cv::Rect(140, 100, 40, 40)));
  const double corner = mean_level(image(cv::Rect(0, 0, 20, 20)));
  EXPECT_NEAR(corner / middle, 1 - VisualSensor{}.vignetting, 0.08);
}

TEST(VisualCamera, NoiseHasTheSizeOfTheModelAndIsFreshInEveryImage) {
  VisualSensor sensor;
  sensor.vignetting = 0;
  VisualCamera camera(kCamera, sensor, 1);
  const cv::Mat first = camera.expose(flat_light(0.5), 0);
  const cv::Mat second = camera.expose(flat_light(0.5), 0);
  cv::Scalar mean, deviation;
  cv::meanStdDev(first, mean, deviation);
  const double expected = std::sqrt(sensor.read_noise * sensor.read_noise +
                                    sensor.shot_noise * sensor.shot_noise * mean[0] + 1.0 / 12);
  EXPECT_NEAR(deviation[0], expected, 0.05 * expected);
  cv::Mat difference;
  cv::subtract(first, second, difference, cv::noArray(), CV_32F);
  cv::meanStdDev(difference, mean, deviation);
  EXPECT_NEAR(deviation[0], expected * std::sqrt(2.0), 0.05 * expected * std::sqrt(2.0));
}

TEST(VisualCamera, SameSeedSameImage) {
  VisualCamera a(kCamera, {}, 7), b(kCamera, {}, 7);
  EXPECT_EQ(cv::norm(a.expose(flat_light(0.5), 0), b.expose(flat_light(0.5), 0), cv::NORM_INF), 0);
}

}  // namespace
}  // namespace covey
