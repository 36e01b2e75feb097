// SPDX-License-Identifier: Apache-2.0
#include "frontend/patch_alignment.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <opencv2/core.hpp>

#include "tests/frontend/synthetic_view.h"

namespace covey {
namespace {

constexpr int kSide = 200;
const Eigen::Vector2d kCentre(100, 100);

// Waves of 7 to 60 px in all directions: a texture that is known exactly between its pixels.
class Waves {
 public:
  Waves() {
    cv::RNG random(3);
    for (Wave& wave : waves_) {
      const double angle = random.uniform(0.0, M_PI);
      const double frequency = 2 * M_PI / random.uniform(7.0, 60.0);
      wave = {frequency * std::cos(angle), frequency * std::sin(angle), random.uniform(0.0, 6.0)};
    }
  }

  [[nodiscard]] double grey(const Eigen::Vector2d& at) const {
    double sum = 120;
    for (const Wave& wave : waves_)
      sum += 14 * std::sin(wave.kx * at.x() + wave.ky * at.y() + wave.phase);
    return sum;
  }

 private:
  struct Wave {
    double kx = 0, ky = 0, phase = 0;  // rad/px, rad/px, rad
  };
  std::array<Wave, 8> waves_;
};

// What lay at the centre lies at centre + shift, turned and stretched by `map` around it.
cv::Mat warped(const Eigen::Matrix2d& map, const Eigen::Vector2d& shift, double gain = 1,
               double offset = 0) {
  const Waves waves;
  const Eigen::Matrix2d inverse = map.inverse();
  cv::Mat image(kSide, kSide, CV_8U);
  for (int y = 0; y < kSide; ++y) {
    for (int x = 0; x < kSide; ++x) {
      const Eigen::Vector2d from_centre = Eigen::Vector2d(x, y) - kCentre - shift;
      const double grey = waves.grey(kCentre + inverse * from_centre);
      image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(gain * grey + offset);
    }
  }
  return image;
}

std::optional<PatchFit> found_again(const cv::Mat& later, const PatchPlace& start) {
  const AlignmentConfig config;
  const cv::Mat first = warped(Eigen::Matrix2d::Identity(), Eigen::Vector2d::Zero());
  const auto patch = Patch::cut(build_pyramid(first, 3), kCentre, config);
  if (!patch) return std::nullopt;
  return patch->align(build_pyramid(later, 3), start, 3, config);
}

PatchPlace at(const Eigen::Vector2d& pixel) {
  PatchPlace place;
  place.pixel = pixel;
  return place;
}

TEST(PatchAlignment, FindsAShiftToAFewHundredthsOfAPixel) {
  for (const Eigen::Vector2d& shift : {Eigen::Vector2d(0, 0), Eigen::Vector2d(0.31, -0.47),
                                       Eigen::Vector2d(-3.6, 2.2), Eigen::Vector2d(5.5, -4.25)}) {
    const auto fit = found_again(warped(Eigen::Matrix2d::Identity(), shift), at(kCentre));
    ASSERT_TRUE(fit.has_value()) << shift.transpose();
    EXPECT_LT((fit->place.pixel - kCentre - shift).norm(), 0.03) << shift.transpose();
    EXPECT_GT(fit->correlation, 0.98);
  }
}

struct Scatter {
  double error_px = 0, claimed_px = 0;  // root mean squares
};

Scatter scatter_with(double noise) {  // grey levels
  const Eigen::Vector2d shift(2, -1);
  const cv::Mat clean = warped(Eigen::Matrix2d::Identity(), shift);
  cv::RNG random(11);
  Scatter scatter;
  constexpr int kRuns = 200;
  for (int i = 0; i < kRuns; ++i) {
    cv::Mat grain(clean.size(), CV_32F), noisy;
    random.fill(grain, cv::RNG::NORMAL, 0.0, noise);
    cv::add(clean, grain, noisy, cv::noArray(), CV_8U);
    const auto fit = found_again(noisy, at(kCentre + shift));
    if (!fit) continue;
    scatter.error_px += (fit->place.pixel - kCentre - shift).squaredNorm() / (2 * kRuns);
    scatter.claimed_px += fit->covariance.trace() / (2 * kRuns);
  }
  return {std::sqrt(scatter.error_px), std::sqrt(scatter.claimed_px)};
}

TEST(PatchAlignment, SaysHowWellThePatchIsFound) {
  const Scatter little = scatter_with(2), much = scatter_with(6);
  EXPECT_NEAR(much.error_px / little.error_px, 3, 0.5);
  EXPECT_NEAR(much.claimed_px / little.claimed_px, 3, 0.5);
  EXPECT_GT(much.error_px / much.claimed_px, 1.0);
  EXPECT_LT(much.error_px / much.claimed_px, 2.0);
}

// Seen from the side, a texture is finer across than along.
TEST(PatchAlignment, SaysInWhichDirectionItIsSure) {
  Eigen::Matrix2d stretch;
  stretch << 1, 0, 0, 5;
  const cv::Mat clean = warped(stretch, Eigen::Vector2d::Zero());
  const AlignmentConfig config;
  const auto patch = Patch::cut(build_pyramid(clean, 3), kCentre, config);
  ASSERT_TRUE(patch.has_value());
  cv::RNG random(12);
  Eigen::Vector2d errors = Eigen::Vector2d::Zero(), claims = Eigen::Vector2d::Zero();  // squared
  for (int i = 0; i < 200; ++i) {
    cv::Mat grain(clean.size(), CV_32F), noisy;
    random.fill(grain, cv::RNG::NORMAL, 0.0, 4);
    cv::add(clean, grain, noisy, cv::noArray(), CV_8U);
    const auto fit = patch->align(build_pyramid(noisy, 3), at(kCentre), 3, config);
    ASSERT_TRUE(fit.has_value());
    errors += (fit->place.pixel - kCentre).cwiseAbs2();
    claims += fit->covariance.diagonal();
  }
  const double elongated = std::sqrt(errors.y() / errors.x());
  EXPECT_GT(elongated, 1.5);
  EXPECT_NEAR(std::sqrt(claims.y() / claims.x()), elongated, 0.25 * elongated);
}

TEST(PatchAlignment, FollowsAnAffineMapItIsToldNearly) {
  Eigen::Matrix2d map;
  map << 1.2, -0.35, 0.3, 1.15;
  PatchPlace start = at(kCentre + Eigen::Vector2d(1, -1));
  start.affine << 1.18, -0.33, 0.32, 1.16;
  const auto fit = found_again(warped(map, Eigen::Vector2d(0.4, 0.3)), start);
  ASSERT_TRUE(fit.has_value());
  EXPECT_LT((fit->place.pixel - kCentre - Eigen::Vector2d(0.4, 0.3)).norm(), 0.06);
  EXPECT_LT((fit->place.affine - map).norm(), (start.affine - map).norm());
  EXPECT_GT(fit->correlation, 0.97);
}

TEST(PatchAlignment, DoesNotSeeGainAndOffset) {
  const Eigen::Vector2d shift(1.3, -0.6);
  const cv::Mat later = warped(Eigen::Matrix2d::Identity(), shift, 0.5, 90);
  const auto fit = found_again(later, at(kCentre));
  ASSERT_TRUE(fit.has_value());
  EXPECT_LT((fit->place.pixel - kCentre - shift).norm(), 0.05);
  EXPECT_GT(fit->correlation, 0.97);
}

TEST(PatchAlignment, AnotherTextureHasALowCorrelationOrNoPlace) {
  cv::Mat other;
  testing_view::random_texture(kSide, 77).convertTo(other, CV_8U);
  const auto fit = found_again(other, at(kCentre));
  EXPECT_LT(fit ? fit->correlation : 0.0, 0.75);
}

TEST(PatchAlignment, FlatAndStripedPatchesAreNotCut) {
  const AlignmentConfig config;
  const cv::Mat flat(kSide, kSide, CV_8U, cv::Scalar(90));
  EXPECT_FALSE(Patch::cut(build_pyramid(flat, 3), kCentre, config).has_value());
  cv::Mat stripes(kSide, kSide, CV_8U);
  for (int x = 0; x < kSide; ++x) stripes.col(x).setTo(120 + 60 * std::sin(0.5 * x));
  EXPECT_FALSE(Patch::cut(build_pyramid(stripes, 3), kCentre, config).has_value());
}

// Waves of 6 px that stay, and of 25 px that have moved to the right.
TEST(PatchAlignment, CoarseTextureThatHasMovedFurtherShowsInTheImageOfHalfTheSize) {
  const auto image_with = [](double coarse_shift) {
    cv::Mat image(kSide, kSide, CV_8U);
    for (int y = 0; y < kSide; ++y) {
      for (int x = 0; x < kSide; ++x) {
        const double fine = std::sin(1.05 * x) + std::sin(1.05 * y + 1);
        const double coarse = std::sin(0.25 * (x - coarse_shift)) + std::sin(0.25 * y + 2);
        image.at<std::uint8_t>(y, x) = cv::saturate_cast<std::uint8_t>(125 + 20 * (fine + coarse));
      }
    }
    return image;
  };
  AlignmentConfig config;
  config.compare_scales = true;
  const auto patch = Patch::cut(build_pyramid(image_with(0), 2), kCentre, config);
  ASSERT_TRUE(patch.has_value());
  const auto shift_in = [&](const cv::Mat& image) {
    const auto found = patch->align(build_pyramid(image, 2), at(kCentre), 2, config);
    return found && found->coarse_shift ? *found->coarse_shift : Eigen::Vector2d(99, 99);
  };
  EXPECT_LT(shift_in(image_with(0)).norm(), 0.03);
  const Eigen::Vector2d shift = shift_in(image_with(0.8));
  EXPECT_GT(shift.x(), 0.3);
  EXPECT_LT(shift.x(), 0.9);
  EXPECT_LT(std::abs(shift.y()), 0.1);
  config.compare_scales = false;
  const auto found = patch->align(build_pyramid(image_with(0.8), 2), at(kCentre), 2, config);
  ASSERT_TRUE(found.has_value());
  EXPECT_FALSE(found->coarse_shift.has_value());
}

TEST(PatchAlignment, PatchesThatWouldLeaveTheImageAreNotCutAndNotFound) {
  const AlignmentConfig config;
  const ImagePyramid pyramid =
      build_pyramid(warped(Eigen::Matrix2d::Identity(), Eigen::Vector2d::Zero()), 3);
  for (const Eigen::Vector2d& pixel :
       {Eigen::Vector2d(3, 100), Eigen::Vector2d(100, 197), Eigen::Vector2d(-50, 1e6)}) {
    EXPECT_FALSE(Patch::cut(pyramid, pixel, config).has_value());
    EXPECT_FALSE(found_again(pyramid.levels[0], at(pixel)).has_value());
  }
}

TEST(PatchAlignment, ADegenerateOrUndefinedStartFindsNothing) {
  const cv::Mat image = warped(Eigen::Matrix2d::Identity(), Eigen::Vector2d::Zero());
  PatchPlace huge = at(kCentre);
  huge.affine *= 1e9;
  EXPECT_FALSE(found_again(image, huge).has_value());
  PatchPlace undefined = at(kCentre);
  undefined.pixel.x() = std::nan("");
  EXPECT_FALSE(found_again(image, undefined).has_value());
}

}  // namespace
}  // namespace covey
