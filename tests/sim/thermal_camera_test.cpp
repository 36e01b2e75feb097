// SPDX-License-Identifier: Apache-2.0
#include "sim/thermal_camera.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <set>

namespace covey {
namespace {

constexpr double kFrame_s = 1.0 / 30;
const CameraIntrinsics kCamera{
    320, 256, 200, 200, 159.5, 127.5, DistortionModel::kEquidistant, {0, 0, 0, 0}};

// From `cold` at the left to `hot` at the right.
cv::Mat ramp(double cold_k, double hot_k) {
  cv::Mat temperature(kCamera.height, kCamera.width, CV_32FC1);
  for (int x = 0; x < kCamera.width; ++x)
    temperature.col(x).setTo(cold_k + (hot_k - cold_k) * x / (kCamera.width - 1.0));
  return temperature;
}

TEST(ThermalCamera, AutomaticGainStretchesTheSceneOverAllLevels) {
  ThermalCamera camera(kCamera, {}, 1, false);
  const cv::Mat grey = camera.expose(ramp(290, 302), kFrame_s).grey;
  EXPECT_LT(cv::mean(grey.col(5))[0], 30);
  EXPECT_GT(cv::mean(grey.col(kCamera.width - 6))[0], 225);
}

TEST(ThermalCamera, GainChangesFromFrameToFrame) {
  ThermalCamera camera(kCamera, {}, 1, false);
  std::set<double> whites;
  for (int k = 0; k < 10; ++k) {
    (void)camera.expose(ramp(290, 302), kFrame_s);
    whites.insert(camera.truth().white_k);
  }
  EXPECT_EQ(whites.size(), 10u);
  EXPECT_GT(*whites.rbegin() - *whites.begin(), 0.05);
}

TEST(ThermalCamera, GreyLevelsAreTheTruthOfGainPatternAndTemperature) {
  ThermalCamera camera(kCamera, {}, 1, false);
  const cv::Mat temperature = ramp(290, 302);
  const cv::Mat grey = camera.expose(temperature, kFrame_s).grey;
  const ThermalTruth& truth = camera.truth();
  cv::Mat expected =
      (temperature + truth.pattern_k - truth.black_k) * (255.0 / (truth.white_k - truth.black_k));
  cv::Mat grey32;
  grey.convertTo(grey32, CV_32F);
  const cv::Rect middle(40, 0, 240, kCamera.height);
  cv::Scalar mean, deviation;
  cv::meanStdDev(grey32(middle) - expected(middle), mean, deviation);
  EXPECT_NEAR(mean[0], 0, 0.1);
  const double noise = ThermalSensor{}.netd_k * 255.0 / (truth.white_k - truth.black_k);
  EXPECT_NEAR(deviation[0], std::sqrt(noise * noise + 1.0 / 12), 0.1);
}

TEST(ThermalCamera, RawCountsAreTemperaturesWithTheStatedNoise) {
  ThermalSensor sensor;
  ThermalCamera camera(kCamera, sensor, 1, false);
  const cv::Mat temperature(kCamera.height, kCamera.width, CV_32FC1, cv::Scalar(295));
  cv::Mat first, second;
  camera.expose(temperature, 0).raw16.convertTo(first, CV_32F, sensor.raw_k_per_count);
  camera.expose(temperature, 0).raw16.convertTo(second, CV_32F, sensor.raw_k_per_count);
  cv::Scalar mean, deviation;
  cv::meanStdDev(first - second, mean, deviation);
  EXPECT_NEAR(deviation[0], sensor.netd_k * std::sqrt(2.0), 0.1 * sensor.netd_k);
  EXPECT_NEAR(cv::mean(first)[0], 295, 1);
}

TEST(ThermalCamera, SlowPatternDriftsButKeepsItsSize) {
  const ThermalSensor sensor;
  ThermalCamera camera(kCamera, sensor, 1, false);
  const cv::Mat scene = ramp(290, 302);
  (void)camera.expose(scene, kFrame_s);
  const cv::Mat before = camera.truth().pattern_k.clone();
  (void)camera.expose(scene, kFrame_s);
  EXPECT_LT(cv::norm(camera.truth().pattern_k, before, cv::NORM_L2) / std::sqrt(before.total()),
            0.05);
  for (int k = 0; k < 50; ++k) (void)camera.expose(scene, sensor.nonuniformity_drift_s);
  EXPECT_GT(cv::norm(camera.truth().pattern_k, before, cv::NORM_L2) / std::sqrt(before.total()),
            0.1);
  cv::Scalar mean, deviation;
  cv::meanStdDev(camera.truth().pattern_k, mean, deviation);
  EXPECT_LT(deviation[0], 2 * sensor.nonuniformity_k);
}

TEST(ThermalCamera, ShutterFreezesTheImageAndThenTheGainJumps) {
  ThermalCamera camera(kCamera, {}, 1, true);
  cv::Mat last;
  double last_white = 0, jump_k = 0;
  int frozen = 0;
  for (int k = 0; k < 300; ++k) {
    const cv::Mat grey = camera.expose(ramp(290, 302), kFrame_s).grey;
    if (camera.truth().shutter_closed) {
      EXPECT_EQ(cv::norm(grey, last, cv::NORM_INF), 0) << "frozen images repeat bit for bit";
      ++frozen;
    } else {
      if (frozen > 0 && jump_k == 0) jump_k = std::abs(camera.truth().white_k - last_white);
      last_white = camera.truth().white_k;
    }
    last = grey;
  }
  EXPECT_GE(frozen, 8);
  EXPECT_LE(frozen, 30);
  EXPECT_GT(jump_k, 0.1);
}

TEST(ThermalCamera, WithoutShutterNothingFreezes) {
  ThermalCamera camera(kCamera, {}, 1, false);
  for (int k = 0; k < 300; ++k) {
    (void)camera.expose(ramp(290, 302), kFrame_s);
    ASSERT_FALSE(camera.truth().shutter_closed);
  }
}

}  // namespace
}  // namespace covey
