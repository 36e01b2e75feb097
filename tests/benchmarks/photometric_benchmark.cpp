// SPDX-License-Identifier: Apache-2.0
//
// What the photometric calibration of a 640x512 image costs, whole and in parts.
#include <benchmark/benchmark.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>

#include "frontend/lag_estimator.h"
#include "frontend/pattern_gain.h"
#include "frontend/photometric_calibration.h"
#include "frontend/pixel_lag.h"
#include "frontend/white_level.h"

namespace covey {
namespace {

const cv::Size kImage(640, 512);
constexpr int kTracks = 200;

// Slides over the same plane, with the sensor's pattern. Without noise: the few images there are
// come again and again, and noise would be taken for the pattern.
cv::Mat scene(int type, int shift) {
  cv::Mat coarse(64, 80, CV_32FC1), plane, columns(1, kImage.width, CV_32FC1);
  cv::Mat pattern(kImage, CV_32FC1);
  cv::theRNG().state = 1;
  cv::randn(coarse, 0, 1);
  cv::randn(columns, 0, 0.2);
  cv::randn(pattern, 0, 0.2);
  cv::resize(coarse, plane, {kImage.width + 64, kImage.height}, 0, 0, cv::INTER_CUBIC);
  cv::Mat image =
      plane.colRange(shift, shift + kImage.width) + pattern + cv::repeat(columns, kImage.height, 1);
  image.convertTo(image, type, type == CV_8UC1 ? 4 : 60, type == CV_8UC1 ? 128 : 29500);
  return image;
}

std::vector<TrackPlace> tracks(int shift) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> share(0.1, 0.9);
  std::vector<TrackPlace> places;
  for (std::uint64_t id = 1; id <= kTracks; ++id) {
    PatchPlace place;
    place.pixel = {kImage.width * share(random) - shift, kImage.height * share(random)};
    places.push_back({id, place});
  }
  return places;
}

void whole_image(benchmark::State& state, int type) {
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  std::vector<cv::Mat> images;
  for (int shift = 0; shift < 60; shift += 2) images.push_back(scene(type, shift));
  TimeNs stamp_ns = nanoseconds(1);
  std::size_t k = 0;
  for (auto _ : state) {
    const int shift = 2 * static_cast<int>(k);
    const auto places = tracks(shift);
    benchmark::DoNotOptimize(calibration.correct(stamp_ns, images[k], places).pixels.data);
    calibration.observe(places);
    stamp_ns += nanoseconds(1.0 / 30);
    k = (k + 1) % images.size();
  }
}

void EightBitImage(benchmark::State& state) { whole_image(state, CV_8UC1); }
void SixteenBitImage(benchmark::State& state) { whole_image(state, CV_16UC1); }
BENCHMARK(EightBitImage)->Unit(benchmark::kMillisecond);
BENCHMARK(SixteenBitImage)->Unit(benchmark::kMillisecond);

// Rotation and tracks that move at up to 240 px/s.
PixelLag moving_lag(const std::vector<TrackPlace>& places) {
  PixelLag lag({640, 512, 293, 293, 319.5, 255.5, DistortionModel::kRadialTangential, {}});
  lag.set_motion({{0.1, 0.2, 0.3}, {}}, places);
  return lag;
}
std::vector<TrackPlace> moving_tracks() {
  std::vector<TrackPlace> places = tracks(0);
  for (TrackPlace& track : places) {
    track.velocity = 0.3 * track.place.pixel;
    track.coarse_shift = Eigen::Vector2d(0.1, 0);
  }
  return places;
}

void LagMotion(benchmark::State& state) {
  const std::vector<TrackPlace> places = moving_tracks();
  PixelLag lag = moving_lag(places);
  for (auto _ : state) lag.set_motion({{0.1, 0.2, 0.3}, {}}, places);
}
void LagTakenOut(benchmark::State& state) {
  PixelLag lag = moving_lag(moving_tracks());
  const cv::Mat grey = scene(CV_8UC1, 0);
  for (auto _ : state) benchmark::DoNotOptimize(lag.taken_out(grey, 0.008).data);
}
void LagEstimate(benchmark::State& state) {
  const std::vector<TrackPlace> places = moving_tracks();
  const PixelLag lag = moving_lag(places);
  LagEstimator estimator(PixelLagConfig{});
  for (auto _ : state) estimator.learn(nanoseconds(1), places, lag);
}
BENCHMARK(LagMotion)->Unit(benchmark::kMillisecond);
BENCHMARK(LagTakenOut)->Unit(benchmark::kMillisecond);
BENCHMARK(LagEstimate)->Unit(benchmark::kMillisecond);

void GainFit(benchmark::State& state) {
  std::mt19937 random(1);
  std::normal_distribution<double> gaussian;
  TemporalGain gain{TemporalConfig{}};
  SpatialField known(SpatialConfig{}, kImage);
  const FieldAt field = [&known](const Eigen::Vector2d& pixel) { return known.at(pixel); };
  std::vector<TrackGrey> greys;
  for (const TrackPlace& track : tracks(0)) {
    greys.push_back({track.patch_id, track.place.pixel, 128 + 4 * gaussian(random)});
  }
  for (int k = 0; k < 40; ++k) gain.add(nanoseconds(1 + k / 30.0), greys, field, {}, {});
  for (auto _ : state) benchmark::DoNotOptimize(gain.estimate(greys, field, {}));
}
BENCHMARK(GainFit)->Unit(benchmark::kMillisecond);

Sight sight(int shift) {
  Sight sight;
  square_means(scene(CV_8UC1, shift), 255, 4).convertTo(sight.levels, CV_32F, 0.25);
  for (const TrackPlace& track : tracks(shift)) {
    sight.tracks.push_back({track.patch_id, track.place.pixel, 0});
  }
  return sight;
}
std::vector<FieldDifference> differences() {
  return compare_blocks(sight(0), sight(6), BlockConfig{});
}
constexpr double kRefresh_s = 0.1;

void FieldSight(benchmark::State& state) {
  const cv::Mat image = scene(CV_8UC1, 0);
  for (auto _ : state) benchmark::DoNotOptimize(square_means(image, white_level(image), 4).data);
}
void FieldSightMasked(benchmark::State& state) {
  const cv::Mat image = scene(CV_8UC1, 0);
  cv::Mat mask(kImage, CV_8UC1, cv::Scalar(255));
  mask.colRange(0, 100) = 0;
  const cv::Mat shown = shown_squares(mask, 4);
  for (auto _ : state)
    benchmark::DoNotOptimize(square_means(image, white_level(image), 4, shown).data);
}
void FieldBlocks(benchmark::State& state) {
  const Sight before = sight(0), now = sight(6);
  for (auto _ : state) benchmark::DoNotOptimize(compare_blocks(before, now, BlockConfig{}).data());
}
BENCHMARK(FieldSight)->Unit(benchmark::kMillisecond);
BENCHMARK(FieldSightMasked)->Unit(benchmark::kMillisecond);
BENCHMARK(FieldBlocks)->Unit(benchmark::kMillisecond);

void FieldUpdate(benchmark::State& state) {
  SpatialField field(SpatialConfig{}, kImage);
  const auto seen = differences();
  for (auto _ : state) field.update(kRefresh_s, seen);
}
void FieldImage(benchmark::State& state) {
  SpatialField field(SpatialConfig{}, kImage);
  field.update(kRefresh_s, differences());
  for (auto _ : state) benchmark::DoNotOptimize(field.image(128).data);
}
BENCHMARK(FieldUpdate)->Unit(benchmark::kMillisecond);
BENCHMARK(FieldImage)->Unit(benchmark::kMillisecond);

void StripeLook(benchmark::State& state) {
  StripePattern stripes(StripeConfig{}, kImage);
  cv::Mat levels;
  scene(CV_8UC1, 0).convertTo(levels, CV_16SC1, 4);
  for (auto _ : state) stripes.look(levels);
}
void StripeImage(benchmark::State& state) {
  StripePattern stripes(StripeConfig{}, kImage);
  cv::Mat levels;
  scene(CV_8UC1, 0).convertTo(levels, CV_16SC1, 4);
  stripes.look(levels);
  for (auto _ : state) stripes.add_to(levels);
}
BENCHMARK(StripeLook)->Unit(benchmark::kMillisecond);
BENCHMARK(StripeImage)->Unit(benchmark::kMillisecond);

void PatternMeasured(benchmark::State& state) {
  PatternGain pattern(PatternGainConfig{});
  pattern.restart(scene(CV_8UC1, 0), 255, 1);
  for (int shift = 6; shift < 60; shift += 6) pattern.look(scene(CV_8UC1, shift), 255, 1);
  const cv::Mat image = scene(CV_8UC1, 3);
  for (auto _ : state) benchmark::DoNotOptimize(pattern.measure(image, 255));
}
void PatternLook(benchmark::State& state) {
  PatternGain pattern(PatternGainConfig{});
  pattern.restart(scene(CV_8UC1, 0), 255, 1);
  const cv::Mat image = scene(CV_8UC1, 6);
  for (auto _ : state) pattern.look(image, 255, 1);
}
BENCHMARK(PatternMeasured)->Unit(benchmark::kMillisecond);
BENCHMARK(PatternLook)->Unit(benchmark::kMillisecond);

// Without tracks there is nothing to fit: detection of the shutter, tables, contrast and the pass
// over the pixels are left.
void ApplyAlone(benchmark::State& state) {
  PhotometricCalibration calibration(PhotometricConfig{}, kImage);
  const cv::Mat images[2] = {scene(CV_8UC1, 0), scene(CV_8UC1, 8)};
  TimeNs stamp_ns = nanoseconds(1);
  int k = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(calibration.correct(stamp_ns, images[k], {}).pixels.data);
    stamp_ns += nanoseconds(1.0 / 30);
    k = 1 - k;
  }
}
BENCHMARK(ApplyAlone)->Unit(benchmark::kMillisecond);

// The rival: contrast-limited adaptive equalisation of every image for itself.
void Clahe(benchmark::State& state) {
  const auto clahe = cv::createCLAHE(10, {8, 8});
  const cv::Mat image = scene(CV_8UC1, 0);
  cv::Mat equalised;
  for (auto _ : state) clahe->apply(image, equalised);
}
BENCHMARK(Clahe)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace covey
