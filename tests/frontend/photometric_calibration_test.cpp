// SPDX-License-Identifier: Apache-2.0
#include "frontend/photometric_calibration.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "estimator/median.h"
#include "sim/field_slope.h"
#include "tests/frontend/synthetic_thermal.h"

namespace covey {
namespace {

const cv::Size kImage(SyntheticThermal::kWidth, SyntheticThermal::kHeight);

// A scene whose contrast changes as the camera moves on must not pull the gain in these few
// seconds, and this camera's field does not wander.
PhotometricConfig free_gain() {
  PhotometricConfig config;
  config.gain.relaxation_s = 600;
  config.field.wander_s = 100;
  return config;
}

struct Flight {
  int chains = 0;
  double worst_gain_error = 0;  // relative, after the first two seconds and against their end
  double final_scale = 1;       // estimated over true gain
  CalibratedImage last;
};

// Gain and offset of the camera swing all the while. The field is not known at first and disturbs
// the gain: what scale the chain has when it is known is a matter of units.
Flight fly(SyntheticThermal& camera, PhotometricCalibration& calibration, int images,
           bool wide = false) {
  constexpr int kSettled = 60;
  Flight flight;
  double unit = 0;
  for (int k = 0; k < images; ++k) {
    camera.gain = std::exp(0.15 * std::sin(k / 10.0));
    camera.offset = 12 * std::sin(k / 25.0);
    flight.last = calibration.correct(camera.stamp_ns(), camera.expose(wide), camera.tracks());
    calibration.observe(camera.tracks());
    flight.chains += flight.last.restarted ? 1 : 0;
    flight.final_scale = flight.last.map.gain / camera.gain;
    if (k == kSettled) unit = flight.final_scale;
    const double error = std::abs(flight.final_scale / unit - 1);
    if (k > kSettled) flight.worst_gain_error = std::max(flight.worst_gain_error, error);
    camera.advance();
  }
  return flight;
}

// `unit`: what one grey level of the camera is in the calibration's units. The camera slides and
// turns over a plane: all patches move alike, and a slope cannot be seen.
double field_error(const SyntheticThermal& camera, const PhotometricCalibration& calibration,
                   double unit) {
  const cv::Mat found = without_slope(calibration.field() / unit);
  const cv::Mat wanted = without_slope(camera.field());
  return cv::norm(found, wanted) / cv::norm(wanted);
}

TEST(PhotometricCalibration, FindsGainWithinTwoAndFieldWithinTwentyPerCent) {
  for (const unsigned seed : {1u, 2u}) {
    SyntheticThermal camera(seed);
    PhotometricCalibration calibration(free_gain(), kImage);
    const Flight flight = fly(camera, calibration, 300);
    EXPECT_LT(flight.worst_gain_error, 0.02) << seed;
    EXPECT_LT(field_error(camera, calibration, flight.final_scale), 0.20) << seed;
  }
}

// Each pixel a little off, grey levels of the first image.
cv::Mat pixel_pattern(unsigned seed) {
  cv::RNG random(seed);
  cv::Mat pattern(kImage, CV_32FC1);
  random.fill(pattern, cv::RNG::NORMAL, 0, 1);
  return pattern;
}

// Of the gain against the chain's first image, relative: the worst from image `from` on. Gain and
// offset swing.
double worst_since_the_first(SyntheticThermal& camera, PhotometricCalibration& calibration,
                             int from, int images, std::size_t tracks) {
  double worst = 0;
  for (int k = 0; k < images; ++k) {
    camera.gain = std::exp(0.15 * std::sin(k / 10.0));
    camera.offset = 12 * std::sin(k / 25.0);
    std::vector<TrackPlace> seen = camera.tracks();
    seen.resize(std::min(seen.size(), tracks));
    (void)calibration.correct(camera.stamp_ns(), camera.expose(), seen);
    calibration.observe(seen);
    if (k >= from) worst = std::max(worst, std::abs(calibration.map().gain / camera.gain - 1));
    camera.advance();
  }
  return worst;
}

TEST(PhotometricCalibration, TheSensorsPatternTellsTheGainWhereTracksAreFew) {
  constexpr std::size_t kTracks = 8;
  SyntheticThermal camera(12);
  camera.stripes = pixel_pattern(1);
  PhotometricConfig config;
  PhotometricCalibration with_pattern(config, kImage);
  EXPECT_LT(worst_since_the_first(camera, with_pattern, 60, 300, kTracks), 0.05);
  config.pattern = false;
  PhotometricCalibration without(config, kImage);
  EXPECT_GT(worst_since_the_first(camera, without, 60, 300, kTracks), 0.10);
}

// A camera that corrects itself without closing its shutter.
TEST(PhotometricCalibration, APatternThatHasBecomeAnotherIsLearntAnew) {
  SyntheticThermal camera(13);
  camera.stripes = pixel_pattern(1);
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  worst_since_the_first(camera, calibration, 0, 150, 200);
  const double before = calibration.map().gain / camera.gain;
  camera.stripes = pixel_pattern(2);
  worst_since_the_first(camera, calibration, 0, 60, 200);
  const double soon_after = calibration.map().gain / camera.gain;
  worst_since_the_first(camera, calibration, 0, 200, 200);
  EXPECT_NEAR(soon_after / before, 1, 0.05);
  EXPECT_NEAR(calibration.map().gain / camera.gain / soon_after, 1, 0.03);
}

TEST(PhotometricCalibration, SixteenBitsGoTheSameWay) {
  SyntheticThermal camera(3);
  PhotometricCalibration calibration(free_gain(), kImage);
  const Flight flight = fly(camera, calibration, 300, true);
  EXPECT_LT(flight.worst_gain_error, 0.03);
  EXPECT_LT(field_error(camera, calibration, 100 * flight.final_scale), 0.20);
  EXPECT_EQ(flight.last.pixels.type(), CV_8UC1);
}

struct View {
  cv::Mat image;
  std::vector<TrackPlace> tracks;
};

// Median difference of the patches' means, of the first image's standard deviation.
double residual(const View& before, const View& now) {
  const auto patch_mean = [](const View& view, const TrackPlace& track) {
    cv::Mat patch;
    cv::getRectSubPix(
        view.image, {7, 7},
        {static_cast<float>(track.place.pixel.x()), static_cast<float>(track.place.pixel.y())},
        patch, CV_32F);
    return cv::mean(patch)[0];
  };
  std::map<std::uint64_t, double> means;
  for (const TrackPlace& track : before.tracks) means[track.patch_id] = patch_mean(before, track);
  cv::Scalar mean, deviation;
  cv::meanStdDev(before.image, mean, deviation);
  std::vector<double> differences;
  for (const TrackPlace& track : now.tracks) {
    const auto found = means.find(track.patch_id);
    if (found == means.end()) continue;
    differences.push_back(std::abs(patch_mean(now, track) - found->second) / deviation[0]);
  }
  const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
  std::nth_element(differences.begin(), middle, differences.end());
  return *middle;
}

// A patch that was followed looks the same in every calibrated image.
TEST(PhotometricCalibration, MatchedPatchesDifferAThirdAsMuchAsInRawImages) {
  SyntheticThermal camera(4);
  PhotometricConfig config;
  config.tone.contrast = Contrast::kLinear;
  PhotometricCalibration calibration(config, kImage);
  fly(camera, calibration, 200);
  const auto look = [&](double gain) {
    camera.gain = gain;
    const View raw{camera.expose().clone(), camera.tracks()};
    const View calibrated{calibration.correct(camera.stamp_ns(), raw.image, raw.tracks).pixels,
                          raw.tracks};
    calibration.observe(raw.tracks);
    return std::pair(raw, calibrated);
  };
  const auto [raw_before, before] = look(0.9);
  for (int k = 0; k < 10; ++k) {
    camera.advance();
    look(0.9 + 0.02 * k);
  }
  camera.advance();
  const auto [raw_now, now] = look(1.1);
  EXPECT_LT(3 * residual(before, now), residual(raw_before, raw_now));
}

TEST(PhotometricCalibration, LevelsOfPatchesStayWhileTheirGreySwings) {
  SyntheticThermal camera(6);
  PhotometricCalibration calibration(free_gain(), kImage);
  fly(camera, calibration, 200);
  const auto look = [&](double gain) {
    camera.gain = gain;
    (void)calibration.correct(camera.stamp_ns(), camera.expose(), camera.tracks());
    calibration.observe(camera.tracks());
    camera.advance();
    return calibration.patch_levels();
  };
  const std::vector<PatchLevel> before = look(0.9);
  for (int k = 1; k < 10; ++k) look(0.9 + 0.02 * k);
  std::vector<double> raw, calibrated;
  for (const PatchLevel& now : look(1.1)) {
    const auto same = std::find_if(before.begin(), before.end(), [&](const PatchLevel& level) {
      return level.patch_id == now.patch_id;
    });
    if (same == before.end()) continue;
    raw.push_back(std::abs(now.raw - same->raw));
    calibrated.push_back(std::abs(now.calibrated - same->calibrated));
  }
  ASSERT_GT(raw.size(), 100u);
  EXPECT_GT(median(raw), 10);
  EXPECT_LT(median(calibrated), 1.5);
}

TEST(PhotometricCalibration, ReplacesHotPixelsAndNoOthers) {
  SyntheticThermal camera(5);
  camera.hot_pixels = {{40, 50}, {200, 100}, {201, 100}};
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  const Flight flight = fly(camera, calibration, 200);
  EXPECT_EQ(calibration.bad_pixels().size(), camera.hot_pixels.size());
  for (const cv::Point& p : camera.hot_pixels) {
    cv::Mat around = flight.last.pixels(cv::Rect(p - cv::Point(2, 2), cv::Size(5, 5))).clone();
    const int here = around.at<std::uint8_t>(2, 2);
    around.at<std::uint8_t>(2, 2) = around.at<std::uint8_t>(0, 0);
    double least = 0, most = 0;
    cv::minMaxLoc(around, &least, &most);
    EXPECT_GE(here, least) << p;
    EXPECT_LE(here, most) << p;
  }
}

std::vector<cv::Point> anywhere(int count) {
  cv::RNG random(11);
  std::vector<cv::Point> points;
  for (int i = 0; i < count; ++i) {
    points.emplace_back(random.uniform(0, kImage.width), random.uniform(0, kImage.height));
  }
  return points;
}

TEST(PhotometricCalibration, ReplacesHotPixelsBeforeASceneFullOfSmallThingsToo) {
  SyntheticThermal camera(5);
  camera.sprinkle(0.005);  // one pixel in 500 would be as many as may be bad
  camera.hot_pixels = anywhere(20);
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  (void)fly(camera, calibration, 200);
  EXPECT_GE(calibration.bad_pixels().size(), 18U);
  for (const cv::Point& bad : calibration.bad_pixels()) {
    EXPECT_EQ(std::count(camera.hot_pixels.begin(), camera.hot_pixels.end(), bad), 1) << bad;
  }
}

TEST(PhotometricCalibration, MorePixelsThanASensorHasBadOnesAreSomethingElse) {
  SyntheticThermal camera(5);
  camera.hot_pixels = anywhere(kImage.area() / 250);
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  (void)fly(camera, calibration, 200);
  EXPECT_TRUE(calibration.bad_pixels().empty());
}

// Nothing tells the sensor's pattern and bad pixels from the scene and small warm things until it
// moves, and nobody knows whether it does who follows no track.
TEST(PhotometricCalibration, TheSceneIsNotTheSensorWhileItStandsStill) {
  SyntheticThermal camera(5);
  camera.hot_pixels = {{40, 50}};
  for (const std::vector<TrackPlace>& tracks : {camera.tracks(), {}}) {
    PhotometricCalibration calibration(PhotometricConfig{}, kImage);
    TimeNs stamp_ns = camera.stamp_ns();
    for (int k = 0; k < 200; ++k, stamp_ns += 33'333'333) {
      const CalibratedImage image = calibration.correct(stamp_ns, camera.expose(), tracks);
      EXPECT_EQ(image.content, ImageContent::kScene);
      calibration.observe(tracks);
      EXPECT_FALSE(calibration.pattern_told()) << k;
    }
    EXPECT_TRUE(calibration.bad_pixels().empty()) << tracks.size() << " tracks";
  }
}

// How much of a pattern of columns is in an image, as it was shown or turned into other units: the
// steps between columns against the pattern's, regression.
double share_of(const cv::Mat& columns, const cv::Mat& image) {
  cv::Mat means;
  cv::reduce(image, means, 0, cv::REDUCE_AVG, CV_32F);
  const auto steps = [](const cv::Mat& row) {
    return cv::Mat(row.colRange(1, row.cols) - row.colRange(0, row.cols - 1));
  };
  const cv::Mat wanted = steps(columns);
  return steps(means).dot(wanted) / wanted.dot(wanted);
}

TEST(PhotometricCalibration, TakesOffWhatColumnsReadTooMuch) {
  cv::Mat columns(1, kImage.width, CV_32FC1);
  cv::RNG(9).fill(columns, cv::RNG::NORMAL, 0, 1);
  const auto left = [&](bool stripes, bool wide) {
    SyntheticThermal camera(8);
    camera.stripes = cv::repeat(columns, kImage.height, 1);
    PhotometricConfig config = free_gain();
    config.stripes = stripes;
    PhotometricCalibration calibration(config, kImage);
    (void)fly(camera, calibration, 100, wide);
    double sum = 0;  // scenes differ from image to image
    for (int k = 0; k < 10; ++k) {
      sum += share_of(columns, fly(camera, calibration, 5, wide).last.pixels);
    }
    return sum;
  };
  EXPECT_LT(left(true, false), 0.3 * left(false, false));
  EXPECT_LT(left(true, true), 0.3 * left(false, true));
}

// How much of the columns' pattern is left in `shown` of what is in `scene`, both as steps along
// rows: regression on the pattern and on the rest of the scene, so that its contrast does not
// count.
double share_left(const cv::Mat& columns, const cv::Mat& scene, const cv::Mat& shown) {
  const auto steps = [](const cv::Mat& image) {
    cv::Mat wide;
    image.convertTo(wide, CV_32F);
    return cv::Mat(wide.colRange(1, wide.cols) - wide.colRange(0, wide.cols - 1));
  };
  const cv::Mat pattern = cv::repeat(steps(columns), scene.rows, 1);
  const cv::Mat rest = steps(scene) - pattern, seen = steps(shown);
  const double pp = pattern.dot(pattern), rr = rest.dot(rest), pr = pattern.dot(rest);
  const double ps = pattern.dot(seen), rs = rest.dot(seen);
  return (ps * rr - rs * pr) / (rs * pp - ps * pr);
}

// Radiometric: columns read as much too much as before, whatever the scene.
TEST(PhotometricCalibration, StripesStayTheSensorsWhenTheSceneHasAnotherContrastAfterTheShutter) {
  cv::Mat columns(1, kImage.width, CV_32FC1);
  cv::RNG(9).fill(columns, cv::RNG::NORMAL, 0, 1);
  for (const double contrast : {0.3, 1.0, 3.0}) {
    SyntheticThermal camera(3);
    camera.field_sigma = 2;
    camera.stripes = cv::repeat(columns, kImage.height, 1);
    PhotometricConfig config = free_gain();
    config.tone.contrast = Contrast::kLinear;
    PhotometricCalibration calibration(config, kImage);
    (void)fly(camera, calibration, 200, true);
    (void)calibration.correct(camera.stamp_ns(), cv::Mat(kImage, CV_16UC1, 30000.0), {});
    camera.advance();
    camera.contrast = contrast;
    const cv::Mat image = camera.expose(true);
    const CalibratedImage seen = calibration.correct(camera.stamp_ns(), image, camera.tracks());
    ASSERT_TRUE(seen.restarted);
    EXPECT_NEAR(share_left(columns, image * (camera.gain / 100), seen.pixels), 0.25, 0.15)
        << contrast;
  }
}

TEST(PhotometricCalibration, ASaturatedHalfDoesNotSteerTheGain) {
  SyntheticThermal camera(6);
  camera.saturated_half = true;
  PhotometricCalibration calibration(free_gain(), kImage);
  EXPECT_LT(fly(camera, calibration, 150).worst_gain_error, 0.03);
}

TEST(PhotometricCalibration, NorDoesOneOfFourteenOrSixteenBits) {
  for (const int white : {16383, 65535}) {
    SyntheticThermal camera(6);
    camera.saturated_half = true;
    camera.white16 = white;
    PhotometricCalibration calibration(free_gain(), kImage);
    EXPECT_LT(fly(camera, calibration, 150, true).worst_gain_error, 0.03) << white;
  }
}

// Sensors of 14 bits at the upper end of 16, of 12, and one that is cut off anywhere.
TEST(PhotometricCalibration, ASaturatedHalfTakesNoContrastFromTheOtherWhereverItIsCutOff) {
  for (const int white : {65532, 65520, 60000}) {
    SyntheticThermal camera(6);
    camera.saturated_half = true;
    camera.white16 = white;
    PhotometricCalibration calibration(free_gain(), kImage);
    const Flight flight = fly(camera, calibration, 90, true);
    cv::Scalar mean, deviation;
    cv::meanStdDev(flight.last.pixels.colRange(kImage.width / 2, kImage.width), mean, deviation);
    EXPECT_GT(deviation[0], 50) << white;
    EXPECT_EQ(flight.chains, 1) << white;
  }
}

// Its value says more than those of all others: hot pixels of 16 bits have thousands of counts.
TEST(PhotometricCalibration, AHotPixelIsNotTheScenesContrast) {
  for (int x = 40; x < 48; ++x) {
    SyntheticThermal camera(5);
    camera.hot_pixels = {{x, 44}, {x, 40}};
    camera.hot16 = 64000;
    camera.field_sigma = 1;
    camera.contrast = 0.03;
    PhotometricCalibration calibration(free_gain(), kImage);
    EXPECT_EQ(fly(camera, calibration, 20, true).chains, 1) << x;
  }
}

TEST(PhotometricCalibration, AUniformImageShowsNothingAndTheNextStartsAnew) {
  SyntheticThermal camera(7);
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  fly(camera, calibration, 30);
  for (const int grey : {0, 117, 255}) {
    const CalibratedImage blind =
        calibration.correct(camera.stamp_ns(), cv::Mat(kImage, CV_8UC1, cv::Scalar(grey)), {});
    EXPECT_EQ(blind.content, ImageContent::kUniform);
    EXPECT_TRUE(blind.pixels.empty());
    calibration.observe({});
    camera.advance();
  }
  const CalibratedImage seen =
      calibration.correct(camera.stamp_ns(), camera.expose(), camera.tracks());
  EXPECT_EQ(seen.content, ImageContent::kScene);
  EXPECT_TRUE(seen.restarted);
  EXPECT_DOUBLE_EQ(seen.map.gain, 1);
}

TEST(PhotometricCalibration, AClosedShutterIsSeenBesideWhatAMaskLeavesOut) {
  SyntheticThermal camera(7);
  cv::Mat mask(kImage, CV_8UC1, cv::Scalar(255));
  mask.colRange(0, 40) = 0;
  PhotometricCalibration calibration(PhotometricConfig{}, kImage, mask);
  fly(camera, calibration, 30);
  cv::Mat closed(kImage, CV_8UC1, cv::Scalar(117));
  camera.last_image().copyTo(closed, mask == 0);
  EXPECT_EQ(calibration.correct(camera.stamp_ns(), closed, {}).content, ImageContent::kUniform);
}

// Like a camera whose output is twice as fast as it.
TEST(PhotometricCalibration, ImagesThatAreAllGivenTwiceAreOneChain) {
  SyntheticThermal camera(1);
  PhotometricCalibration calibration(free_gain(), kImage);
  for (int k = 0; k < 300; ++k) {
    const TimeNs stamp_ns = camera.stamp_ns();
    const Flight flight = fly(camera, calibration, 1);
    EXPECT_EQ(flight.last.restarted, k == 0) << k;
    const CalibratedImage again =
        calibration.correct(stamp_ns + 16'000'000, camera.last_image(), camera.tracks());
    EXPECT_EQ(again.content, ImageContent::kRepeated) << k;
    EXPECT_TRUE(again.pixels.empty()) << k;
    calibration.observe(camera.tracks());
  }
  EXPECT_LT(field_error(camera, calibration, calibration.map().gain / camera.gain), 0.20);
}

TEST(PhotometricCalibration, ARepeatedImageIsNotTracked) {
  SyntheticThermal camera(8);
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  fly(camera, calibration, 30);
  const cv::Mat repeated = camera.last_image().clone();
  for (int k = 0; k < 9; ++k) {
    EXPECT_NE(calibration.correct(camera.stamp_ns(), repeated, camera.tracks()).content,
              ImageContent::kScene);
    camera.advance();
  }
  const CalibratedImage seen =
      calibration.correct(camera.stamp_ns(), camera.expose(), camera.tracks());
  EXPECT_TRUE(seen.restarted);
  EXPECT_FALSE(seen.pixels.empty());
}

TEST(PhotometricCalibration, AHoveringCamerasNoiseIsNotARepeatedImage) {
  SyntheticThermal camera(9);
  camera.noise = 0.25;  // grey levels, as after a stretch over 40 K
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  for (int k = 0; k < 5; ++k) {
    EXPECT_EQ(calibration.correct(camera.stamp_ns(), camera.expose(), camera.tracks()).content,
              ImageContent::kScene);
  }
}

}  // namespace
}  // namespace covey
