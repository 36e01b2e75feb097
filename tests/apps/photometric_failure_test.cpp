// SPDX-License-Identifier: Apache-2.0
//
// A photometric calibration that fails hands the tracker images whose gain is wrong, and the field
// with them. The filter may get less accurate, but not overconfident. Rendered images, whole
// pipeline; minutes without optimisation.
#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>

#include "apps/dataset.h"
#include "apps/path_figures.h"
#include "apps/pipeline.h"
#include "tests/apps/command_run.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

// Four flights of 3 degrees of freedom: in 99.9 % of cases the mean NEES of honest filters lies
// below chi-square(12, 0.999) / 4 = 32.9 / 4.
constexpr double kMostMeanNees = 8.2;

// What a failed calibration makes of the image with this number.
using Failure = std::function<cv::Mat(const cv::Mat& grey, int number)>;

struct Honesty {
  double position = 0, orientation = 0;  // NEES, mean over the flight
  int restarts = 0;
  double gated = 0;  // of the tracks that were tried, share
};

Honesty fly(const Dataset& dataset, const Failure& failure) {
  AgentConfig config;
  config.agent.mode = FlightMode::kSolo;
  config.thermal.mode = ThermalMode::kRaw;  // the failure is in the images
  Pipeline pipeline(config, {dataset.camera, dataset.extrinsics, dataset.imu_noise, true},
                    dataset.ground_truth);
  Honesty honesty;
  std::size_t next_imu = 0;
  int number = 0, judged = 0;
  double used = 0, gated = 0;
  for (const ImageEntry& image : dataset.images) {
    const TimeNs moment_ns = pipeline.imu_moment(image.stamp_ns);
    add_imu_for(image.stamp_ns, dataset.imu, next_imu, pipeline);
    const cv::Mat grey = read_image(image, dataset.camera.width, dataset.camera.height);
    const ImageResult result = pipeline.add_image(image.stamp_ns, failure(grey, number++));
    honesty.restarts += result.update.reinitialized ? 1 : 0;
    used += result.update.msckf_used + result.update.slam_used;
    gated += result.update.msckf_gated + result.update.slam_gated;
    const auto truth = ground_truth_at(*dataset.ground_truth, moment_ns);
    if (!result.odometry || !truth) continue;
    const NeesSample nees = nees_of(*result.odometry, truth->pose);
    honesty.position += nees.position;
    honesty.orientation += nees.orientation;
    ++judged;
  }
  honesty.position /= judged;
  honesty.orientation /= judged;
  honesty.gated = gated / (used + gated);
  return honesty;
}

void simulate(const std::string& seed, const std::filesystem::path& out) {
  run_command("simulate mars_yard --seconds 4 --rate 15 --seed " + seed + " --out " + out.string());
}

Honesty mean_honesty(const Failure& failure) {
  const TemporaryFolder folder;
  Honesty mean;
  double flights = 0;
  for (const char* seed : {"31", "32"}) {
    simulate(seed, folder.path() / seed);
    for (const DroneFolder& drone : find_drones(folder.path() / seed)) {
      const Honesty honesty = fly(read_dataset(drone.mav0), failure);
      mean.position += honesty.position;
      mean.orientation += honesty.orientation;
      mean.restarts += honesty.restarts;
      mean.gated += honesty.gated;
      ++flights;
    }
  }
  mean.position /= flights;
  mean.orientation /= flights;
  mean.gated /= flights;
  return mean;
}

void expect_honest(const Honesty& honesty) {
  EXPECT_EQ(honesty.restarts, 0);
  EXPECT_LT(honesty.position, kMostMeanNees);
  EXPECT_LT(honesty.orientation, kMostMeanNees);
  EXPECT_GT(honesty.position, 0.1) << "nor does it give up what it knows";
}

cv::Mat scaled(const cv::Mat& grey, double gain) {
  constexpr double kMiddle = 127;
  cv::Mat wrong;
  grey.convertTo(wrong, CV_8U, gain, (1 - gain) * kMiddle);
  return wrong;
}

TEST(PhotometricFailure, AGainWrongByAThirdEveryOtherImageIsNotMistakenForMotion) {
  expect_honest(mean_honesty(
      [](const cv::Mat& grey, int number) { return scaled(grey, number % 2 == 0 ? 1.3 : 0.7); }));
}

// A field that was learnt wrongly and drifts on: low waves of 20 grey levels, which cross the image
// in four seconds and turn over every second.
cv::Mat under_a_wrong_field(const cv::Mat& grey, int number) {
  constexpr double kRate = 15, kAmplitude = 20;
  const double seconds = number / kRate;
  const double amplitude = kAmplitude * std::cos(M_PI * seconds);
  cv::Mat wrong(grey.size(), CV_8U);
  for (int y = 0; y < grey.rows; ++y) {
    const double down = std::cos(M_PI * y / grey.rows);
    for (int x = 0; x < grey.cols; ++x) {
      const double across = std::sin(2 * M_PI * (static_cast<double>(x) / grey.cols - seconds / 4));
      wrong.at<std::uint8_t>(y, x) =
          cv::saturate_cast<std::uint8_t>(grey.at<std::uint8_t>(y, x) + amplitude * across * down);
    }
  }
  return wrong;
}

TEST(PhotometricFailure, AFieldThatIsOffAndMovesIsNotMistakenForMotion) {
  expect_honest(mean_honesty(under_a_wrong_field));
}

// What the sensor adds to a fifth of each image and nobody has taken off: blots that stand still in
// it while the scene moves on, and have corners.
cv::Mat beside_a_fixed_pattern(const cv::Mat& grey, int /*number*/) {
  constexpr double kSigma = 40;  // grey levels
  cv::Mat pattern(grey.size(), CV_32FC1), wrong;
  cv::RNG(7).fill(pattern, cv::RNG::NORMAL, 0, 1);
  cv::GaussianBlur(pattern, pattern, {}, 2);
  cv::Scalar mean, deviation;
  cv::meanStdDev(pattern, mean, deviation);
  pattern.colRange(grey.cols / 5, grey.cols) = 0;
  cv::add(grey, pattern * (kSigma / deviation[0]), wrong, cv::noArray(), CV_8U);
  return wrong;
}

TEST(PhotometricFailure, APatternThatStandsStillIsNotMistakenForRest) {
  const Honesty honesty = mean_honesty(beside_a_fixed_pattern);
  expect_honest(honesty);
  EXPECT_GT(honesty.gated, 0);
}

}  // namespace
}  // namespace covey
