// SPDX-License-Identifier: Apache-2.0
#include "frontend/spatial_field.h"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <cstdint>
#include <random>

namespace covey {
namespace {

const cv::Size kImage(640, 512);

// As large as half the image's standard deviation; smooth, as a lens that warms up leaves it.
double truth(const Eigen::Vector2d& p) {
  return 0.6 * std::sin(p.x() / 110) * std::cos(p.y() / 140) + 0.35 * std::cos(p.x() / 170 + 1);
}

SpatialConfig that_stands_still() {
  SpatialConfig config;
  config.wander_s = 1000;
  return config;
}

template <typename Function>
cv::Mat sampled(const Function& function) {
  cv::Mat values(kImage.height / 8, kImage.width / 8, CV_64FC1);
  for (int y = 0; y < values.rows; ++y) {
    for (int x = 0; x < values.cols; ++x) values.at<double>(y, x) = function({8.0 * x, 8.0 * y});
  }
  return values - cv::mean(values)[0];
}

// RMS over RMS of the truth; the mean cannot be seen and does not count.
double relative_error(const SpatialField& field) {
  const cv::Mat wanted = sampled(truth);
  const cv::Mat found = sampled([&](const Eigen::Vector2d& p) { return field.at(p); });
  return cv::norm(wanted, found) / cv::norm(wanted);
}

// Pairs of images, each with 100 patches seen in both; the camera turns and shifts between them,
// and its gain and offset change.
void fly_over(SpatialField& field, std::mt19937& random, int pairs, double outlier_share) {
  std::uniform_real_distribution<double> share(0, 1);
  std::normal_distribution<double> gaussian;
  for (int k = 0; k < pairs; ++k) {
    const Eigen::Vector2d shift(40 * gaussian(random), 40 * gaussian(random));
    const Eigen::Rotation2Dd turn(0.2 * gaussian(random));
    const double gain = 1 + 0.05 * gaussian(random), offset = gaussian(random);
    std::vector<FieldDifference> differences;
    for (int i = 0; i < 100; ++i) {
      FieldDifference d;
      d.from = {640 * share(random), 512 * share(random)};
      d.to = Eigen::Vector2d(320, 256) + turn * (d.from - Eigen::Vector2d(320, 256)) + shift;
      if (d.to.minCoeff() < 0 || d.to.x() > 639 || d.to.y() > 511) continue;
      const double radiance = gaussian(random);
      d.from_level = radiance + truth(d.from) + 0.05 * gaussian(random);
      d.to_level = gain * (radiance + truth(d.to) + 0.05 * gaussian(random)) + offset;
      if (share(random) < outlier_share) d.to_level += 2 * gaussian(random);
      differences.push_back(d);
    }
    field.update(0.2, differences);
  }
}

TEST(SpatialField, IsFoundWithinATenthFromTwentyPairsOfImages) {
  SpatialField field(that_stands_still(), kImage);
  std::mt19937 random(1);
  fly_over(field, random, 20, 0);
  EXPECT_LT(relative_error(field), 0.10);
}

// The same lens over a sensor of half as many pixels: the same field, to a rounding.
TEST(SpatialField, ItsScaleIsThatOfTheSensor) {
  SpatialField large(that_stands_still(), kImage), small(that_stands_still(), kImage / 2);
  std::mt19937 random(9);
  std::uniform_real_distribution<double> share(0, 1);
  for (int k = 0; k < 10; ++k) {
    std::vector<FieldDifference> differences;
    for (int i = 0; i < 100; ++i) {
      FieldDifference d;
      d.from = {640 * share(random), 512 * share(random)};
      d.to = {640 * share(random), 512 * share(random)};
      d.from_level = truth(d.from);
      d.to_level = truth(d.to);
      differences.push_back(d);
    }
    large.update(0.2, differences);
    for (FieldDifference& d : differences) {
      d.from /= 2;
      d.to /= 2;
    }
    small.update(0.2, differences);
  }
  EXPECT_NEAR(small.at({80, 200}), large.at({160, 400}), 1e-4);
  EXPECT_NEAR(small.at({300, 30}), large.at({600, 60}), 1e-4);
  EXPECT_LT(relative_error(large), 0.10);
}

TEST(SpatialField, BearsATenthOfTheTracksSliding) {
  SpatialField field(that_stands_still(), kImage);
  std::mt19937 random(2);
  fly_over(field, random, 40, 0.1);
  EXPECT_LT(relative_error(field), 0.20);
}

TEST(SpatialField, StaysFlatWithoutObservations) {
  SpatialField field(SpatialConfig{}, kImage);
  field.update(0.2, {});
  EXPECT_EQ(field.at({320, 256}), 0);
  EXPECT_EQ(cv::countNonZero(field.image(128)), 0);
}

// What three differences show must not look like much of a field then.
TEST(SpatialField, IsSmallAfterTheCameraHasCorrectedItself) {
  std::vector<FieldDifference> differences;
  for (int i = 0; i < 12; ++i) {
    const Eigen::Vector2d from(100 + 20 * i, 300), to(110 + 20 * i, 200);
    differences.push_back({from, to, 0.1 * i * i, 0.1 * i * i + (i % 2 == 0 ? 0.2 : -0.1)});
  }
  SpatialField usual(SpatialConfig{}, kImage), corrected(SpatialConfig{}, kImage);
  corrected.reset(0.1);
  usual.update(0.1, differences);
  corrected.update(0.1, differences);
  const auto size = [](const SpatialField& field) {
    return cv::norm(sampled([&](const Eigen::Vector2d& p) { return field.at(p); }));
  };
  EXPECT_GT(size(corrected), 0);
  EXPECT_LT(size(corrected), 0.5 * size(usual));
}

TEST(SpatialField, OldObservationsGiveWayToNewOnes) {
  SpatialField field(SpatialConfig{}, kImage);
  std::mt19937 random(3);
  fly_over(field, random, 20, 0);
  field.update(100, {});
  std::uniform_real_distribution<double> share(0, 1);
  std::vector<FieldDifference> flat;
  for (int i = 0; i < 1000; ++i) {
    const Eigen::Vector2d from(600 * share(random), 480 * share(random));
    const double radiance = share(random);
    flat.push_back({from, from + Eigen::Vector2d(40 * share(random), 25), radiance, radiance});
  }
  field.update(0.2, flat);
  EXPECT_LT(std::abs(field.at({100, 100}) - field.at({500, 400})), 0.02);
}

// Each node is an Ornstein-Uhlenbeck process: what was seen five seconds ago is half wrong by now.
TEST(SpatialField, FollowsAFieldThatWanders) {
  constexpr double kWander_s = 25, kRefresh_s = 0.2;
  SpatialField field(SpatialConfig{}, kImage);
  std::mt19937 random(5);
  std::normal_distribution<double> gaussian;
  std::uniform_real_distribution<double> share(0, 1);
  const double keep = std::exp(-kRefresh_s / kWander_s);
  Eigen::Vector4d weight(0.3, -0.2, 0.4, 0.1);  // of four smooth patterns
  const auto wandering = [](const Eigen::Vector4d& w, const Eigen::Vector2d& p) {
    return w(0) * std::sin(p.x() / 90) + w(1) * std::cos(p.x() / 110) * std::sin(p.y() / 100) +
           w(2) * std::cos(p.y() / 80) + w(3) * std::sin((p.x() + p.y()) / 120);
  };
  double error = 0, size = 0;
  for (int k = 0; k < 100; ++k) {
    const Eigen::Vector4d before = weight;
    for (double& w : weight) w = keep * w + 0.3 * std::sqrt(1 - keep * keep) * gaussian(random);
    const double zoom = 1.04, shift = 12 * std::sin(0.2 * k);
    std::vector<FieldDifference> differences;
    for (int i = 0; i < 150; ++i) {
      FieldDifference d;
      d.from = {30 + 580 * share(random), 30 + 450 * share(random)};
      d.to =
          Eigen::Vector2d(320 + shift, 256 - shift) + zoom * (d.from - Eigen::Vector2d(320, 256));
      const double radiance = gaussian(random);
      d.from_level = radiance + wandering(before, d.from);
      d.to_level = radiance + wandering(weight, d.to) + 0.03 * gaussian(random);
      differences.push_back(d);
    }
    field.update(kRefresh_s, differences);
    if (k < 20) continue;
    const cv::Mat wanted = sampled([&](const Eigen::Vector2d& p) { return wandering(weight, p); });
    const cv::Mat found = sampled([&](const Eigen::Vector2d& p) { return field.at(p); });
    error += cv::norm(wanted, found);
    size += cv::norm(wanted);
  }
  EXPECT_LT(error, 0.25 * size);
}

TEST(SpatialField, ImageIsTheFieldBetweenTheNodes) {
  SpatialField field(SpatialConfig{}, kImage);
  std::mt19937 random(4);
  fly_over(field, random, 20, 0);
  const cv::Mat image = field.image(1000);
  ASSERT_EQ(image.size(), kImage);
  for (const cv::Point p : {cv::Point(0, 0), {639, 511}, {333, 77}, {64, 96}}) {
    EXPECT_NEAR(image.at<std::int16_t>(p), 1000 * field.at({p.x * 1.0, p.y * 1.0}), 1.0) << p;
  }
}

// Where a cell ends and the next one begins is not always the same number in floating point.
TEST(SpatialField, EveryColumnIsOfSomeCellWhateverTheGrid) {
  SpatialConfig config;
  for (config.cells_across = 50; config.cells_across <= 70; config.cells_across += 10) {
    for (const int width : {256, 320, 512, 640, 1024}) {
      const cv::Size size(width, width / 4);
      SpatialField field(config, size);
      std::vector<FieldDifference> slope;
      for (int x = 0; x + 40 < width; x += 10) {
        slope.push_back({{x + 0.0, 10}, {x + 40.0, 12}, 0, x < width / 2 ? 0.4 : -0.4});
      }
      field.update(0.2, slope);
      const cv::Mat image = field.image(1000);
      for (int x = 0; x < width; ++x) {
        ASSERT_NEAR(image.at<std::int16_t>(20, x), 1000 * field.at({x * 1.0, 20}), 2)
            << config.cells_across << " cells, column " << x << " of " << width;
      }
    }
  }
}

}  // namespace
}  // namespace covey
