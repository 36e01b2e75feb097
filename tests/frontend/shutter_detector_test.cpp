// SPDX-License-Identifier: Apache-2.0
#include "frontend/shutter_detector.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

#include "tests/frontend/synthetic_view.h"

namespace covey {
namespace {

constexpr TimeNs kStart_ns = 1'000'000'000;

// What a kelvin is worth, and how noisy it is.
struct Camera {
  double counts_per_kelvin = 0;
  double noise_k = 0.04;
};

cv::Mat exposed(const Camera& camera, const cv::Mat& kelvin, unsigned seed) {
  cv::RNG random(seed);
  cv::Mat noise(kelvin.size(), CV_32FC1), counts;
  random.fill(noise, cv::RNG::NORMAL, 0, camera.noise_k);
  cv::Mat(kelvin + noise).convertTo(counts, CV_16U, camera.counts_per_kelvin, 20000);
  return counts;
}

// Within 2 K.
cv::Mat scene() {
  cv::Mat kelvin = testing_view::random_texture(384, 5)(cv::Rect(0, 0, 320, 240)).clone();
  cv::normalize(kelvin, kelvin, 0, 2, cv::NORM_MINMAX, CV_32F);
  return kelvin;
}

// 0.1 K, 0.01 K and 1 mK per count; a camera that is noisier.
TEST(ShutterDetector, TellsAShutterFromAFaintSceneWhateverACountIsWorth) {
  const cv::Mat kelvin = scene(), shutter(kelvin.size(), CV_32FC1, cv::Scalar(1));
  for (const Camera& camera : {Camera{10}, Camera{100}, Camera{1000}, Camera{100, 0.1}}) {
    const auto content = [&](const cv::Mat& seen, unsigned seed) {
      return ShutterDetector(ShutterConfig{}).look(kStart_ns, exposed(camera, seen, seed));
    };
    EXPECT_EQ(content(kelvin, 1), ImageContent::kScene) << camera.counts_per_kelvin;
    EXPECT_EQ(content(shutter, 2), ImageContent::kUniform) << camera.counts_per_kelvin;
  }
}

// A fisheye's circle, or a rectified image's corners.
cv::Mat within_a_circle(const cv::Size& size) {
  cv::Mat mask(size, CV_8UC1, cv::Scalar(0));
  cv::circle(mask, cv::Point(size / 2), size.height / 2, cv::Scalar(255), cv::FILLED);
  return mask;
}

// With a mask whatever the surround shows; without one if it has always been black.
TEST(ShutterDetector, ASurroundIsNotTheScene) {
  const cv::Mat kelvin = scene(), shutter(kelvin.size(), CV_32FC1, cv::Scalar(1));
  const cv::Mat circle = within_a_circle(kelvin.size());
  for (const bool masked : {true, false}) {
    ShutterDetector detector(ShutterConfig{}, masked ? circle : cv::Mat());
    const auto look = [&](double seconds, const cv::Mat& seen, unsigned seed) {
      cv::Mat image = exposed({100}, seen, seed);
      image.setTo(masked ? seed * 1000 : 0, circle == 0);
      return detector.look(kStart_ns + nanoseconds(seconds), image);
    };
    EXPECT_EQ(look(0.00, kelvin, 1), ImageContent::kScene) << masked;
    EXPECT_EQ(look(0.05, shutter, 2), ImageContent::kUniform) << masked;
    EXPECT_EQ(look(0.10, shutter, 3), ImageContent::kUniform) << masked;
    EXPECT_EQ(look(0.15, kelvin, 4), ImageContent::kScene) << masked;
    EXPECT_EQ(look(0.20, kelvin, 5), ImageContent::kScene) << masked;
  }
}

// Automatic gain may make all but one thing black, which yet is a scene.
TEST(ShutterDetector, AnEvenThingBeforeWhatHasTurnedBlackIsAScene) {
  ShutterDetector detector(ShutterConfig{});
  EXPECT_EQ(detector.look(kStart_ns, exposed({100}, scene(), 1)), ImageContent::kScene);
  cv::Mat image = exposed({100}, cv::Mat(240, 320, CV_32FC1, cv::Scalar(1)), 2);
  image.colRange(0, 200) = 0;
  EXPECT_EQ(detector.look(kStart_ns + nanoseconds(0.05), image), ImageContent::kScene);
}

TEST(ShutterDetector, AnImageLikeTheLastOneIsRepeated) {
  ShutterDetector detector(ShutterConfig{});
  const cv::Mat kelvin = scene();
  const auto look = [&](unsigned seed) {
    return detector.look(kStart_ns, exposed({100}, kelvin, seed));
  };
  EXPECT_EQ(look(1), ImageContent::kScene);
  EXPECT_EQ(look(2), ImageContent::kScene) << "other noise";
  EXPECT_EQ(look(2), ImageContent::kRepeated);
}

TEST(ShutterDetector, AnImageGivenTwiceIsNoClosedShutterButOneThatStaysIs) {
  ShutterDetector detector(ShutterConfig{});
  const cv::Mat kelvin = scene();
  const auto look = [&](double seconds, unsigned seed) {
    return detector.look(kStart_ns + nanoseconds(seconds), exposed({100}, kelvin, seed));
  };
  EXPECT_EQ(look(0.00, 1), ImageContent::kScene);
  EXPECT_EQ(look(0.05, 1), ImageContent::kRepeated);
  EXPECT_EQ(look(0.10, 1), ImageContent::kRepeated);
  EXPECT_EQ(look(0.15, 1), ImageContent::kFrozen);
  EXPECT_EQ(look(0.20, 2), ImageContent::kScene);
  EXPECT_EQ(look(0.25, 2), ImageContent::kRepeated);
}

}  // namespace
}  // namespace covey
