// SPDX-License-Identifier: Apache-2.0
//
// Thermal images as the tracker wants them: gain and offset of every image and the additive field
// taken out (Das, Matthies and Daftry, "Online photometric calibration of automatic gain thermal
// infrared cameras", RA-L 2021), dead and hot pixels replaced, contrast spread over 8 bits. What
// it compares are the tracker's own tracks: where they are about to be looked for gives the image's
// gain before it is tracked, where they are found refines it; and blocks that move between them.
//
// 8-bit images of automatic gain and 14- or 16-bit radiometric ones go the same way. Not
// thread-safe; same input, same output.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <opencv2/core.hpp>
#include <vector>

#include "estimator/measurements.h"
#include "frontend/bad_pixels.h"
#include "frontend/block_differences.h"
#include "frontend/shutter_detector.h"
#include "frontend/spatial_field.h"
#include "frontend/stripe_pattern.h"
#include "frontend/temporal_gain.h"
#include "frontend/tone_curve.h"
#include "frontend/tracker.h"

namespace covey {

// Against the chain's first image, beyond which a chain has gone astray.
struct ChainConfig {
  double most_stretch = 5;   // times narrower or wider
  double most_shift = 11.2;  // of its mean, that image's standard deviations
};

struct PhotometricConfig {
  // What is estimated; without any, contrast only.
  bool temporal = true, spatial = true, stripes = true;
  bool pattern = true;  // gain from the sensor's own pattern, too
  TemporalConfig gain;
  PatternGainConfig pattern_gain;
  SpatialConfig field;
  BlockConfig block;
  StripeConfig stripe;
  ShutterConfig shutter;
  BadPixelConfig bad_pixels;
  double cut_off_share = 0.005;  // of the pixels: see white_level.h
  ChainConfig chain;
  ToneConfig tone;
};

struct CalibratedImage {
  ImageContent content = ImageContent::kScene;
  // The first of a chain: after the camera did not see, or because the chain went astray.
  bool restarted = false;
  TimeNs chain_ns = 0;  // stamp of the chain's first image
  GainOffset map;       // from the image's grey levels to those of the chain's first image
  cv::Mat pixels;       // CV_8UC1; empty when it shows no scene
};

// Mean of a track's patch, warped with it.
struct PatchLevel {
  std::uint64_t patch_id = 0;
  double raw = 0;         // grey levels of the image
  double calibrated = 0;  // grey levels of the chain's first image, without the field
};

class PhotometricCalibration {
 public:
  // `mask`: as the tracker's; the field is not looked for where it is zero.
  PhotometricCalibration(const PhotometricConfig& config, cv::Size image_size,
                         const cv::Mat& mask = cv::Mat());

  // `image`: CV_8UC1 or CV_16UC1 in time order; not copied, its buffer must stay as it is until
  // observe() has returned. What is given back has a buffer of its own, never written again.
  // `expected`: where the tracker will look for its tracks in it.
  [[nodiscard]] CalibratedImage correct(TimeNs stamp_ns, const cv::Mat& image,
                                        const std::vector<TrackPlace>& expected);
  // Where they were found in that image. Of one that shows no scene nothing is learnt.
  void observe(const std::vector<TrackPlace>& tracks);

  // As the tracks of the last image have it, better than the map by which it was shown to them.
  [[nodiscard]] const GainOffset& map() const { return gain_.latest(); }
  // Whether the sensor's pattern told the gain of the last image.
  [[nodiscard]] bool pattern_told() const { return told_ && gain_.contradictions() == 0; }
  // The additive field, CV_32FC1, in grey levels of the chain's first image.
  [[nodiscard]] cv::Mat field() const;
  // Of the tracks in the last image that was observed, rising ids.
  [[nodiscard]] std::vector<PatchLevel> patch_levels() const;
  [[nodiscard]] const std::vector<cv::Point>& bad_pixels() const { return bad_pixels_.found(); }

 private:
  void restart(const cv::Mat& image);
  void choose_units(const cv::Mat& image);
  [[nodiscard]] GainOffset like_the_first() const;
  [[nodiscard]] std::vector<TrackGrey> look(const std::vector<TrackPlace>& places) const;
  [[nodiscard]] FieldAt field_at() const;
  [[nodiscard]] Sight sight() const;
  void refresh(double elapsed_s);
  [[nodiscard]] cv::Mat sensor_levels() const;
  void rebuild_bias();
  [[nodiscard]] bool has_moved(std::vector<TrackGrey>& since, double travel_px) const;
  void look_at_pattern();
  void check_pixels();
  void build_table(const GainOffset& map);
  [[nodiscard]] cv::Mat apply() const;
  [[nodiscard]] std::vector<int> levels(int step_px) const;

  PhotometricConfig config_;
  cv::Mat shown_;  // squares that the mask leaves whole
  ShutterDetector shutter_;
  TemporalGain gain_;
  SpatialField field_;
  StripePattern stripes_;
  PatternGain pattern_gain_;
  std::optional<MeasuredGain> told_;  // by the pattern, of the current image
  std::vector<TrackGrey> looked_;     // when the pattern was looked at for the last time
  double travelled_px_ = 0;           // by the scene, since the stripes were looked at
  BadPixels bad_pixels_;
  ToneCurve tone_;

  cv::Mat image_;    // the current one, as it came; empty when it shows no scene
  int white_ = 255;  // its grey level where the sensor is saturated
  bool blind_ = true;
  TimeNs stamp_ns_ = 0, chain_ns_ = 0, refreshed_ns_ = 0, checked_ns_ = 0;
  double centre_ = 0, sigma_ = 1;    // of the chain's first image, grey levels
  std::vector<std::int16_t> table_;  // image's grey level to calibrated level
  cv::Mat bias_;                     // CV_16SC1, field and stripes, calibrated levels
  std::vector<TrackGrey> seen_;      // in the last image; by patch
  Sight last_sight_;                 // at the last refresh
  std::vector<TrackGrey> checked_;   // when pixels were checked for the last time
};

}  // namespace covey
