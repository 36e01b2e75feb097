// SPDX-License-Identifier: Apache-2.0
//
// An uncooled longwave infrared camera with 8-bit automatic gain: temperatures in, grey levels out.
// Everything that makes raw thermal images hard to track is here and can be looked up afterwards.
#pragma once

#include <cstdint>
#include <opencv2/core/mat.hpp>

#include "frontend/camera.h"
#include "sim/noise_table.h"
#include "sim/random.h"

namespace covey {

// FLIR Boson 640, industrial grade: 640x512 pixels, 7.5..13.5 um, NETD below 40 mK, time constant
// 8 ms (Polizzi et al. 2022, section V; datasheet 102-2013-40, release 340, 2021: below 40 mK at
// f/1.0). We know no published figures for the rest. Real cameras look at their shutter for less
// than a second every few minutes (docs/thermal.md), ours so often that a short flight meets it.
struct ThermalSensor {
  double netd_k = 0.040;              // K, temporal noise of a pixel, standard deviation
  double time_constant_s = 0.008;     // s, of the microbolometer: it shows the past, exponentially
  double fixed_pixel_k = 0.020;       // K, fixed pattern: each pixel
  double fixed_column_k = 0.025;      // K, fixed pattern: each column
  double fixed_row_k = 0.010;         // K, fixed pattern: each row
  double nonuniformity_k = 0.35;      // K, slow low-frequency additive pattern, standard deviation
  double nonuniformity_drift_s = 25;  // s, correlation time of that pattern
  int nonuniformity_cells = 5;        // cells over the width of the image
  double agc_low = 0.005, agc_high = 0.995;  // share of pixels below the black and the white level
  double agc_smoothing_s = 0.12;             // s, time constant of the automatic gain
  double agc_jitter = 0.012;                 // of the range, frame to frame, standard deviation
  double min_range_k = 3.0;                  // K, least range that is stretched over 256 levels
  double shutter_interval_s = 7.0;           // s, mean time between flat-field corrections
  double shutter_hold_s = 0.3;               // s, the last image is repeated for so long
  double raw_k_per_count = 0.01;             // K, resolution of the 16-bit output; count 0 is 0 K
};

// What was done to the temperatures of the last image.
struct ThermalTruth {
  double black_k = 0, white_k = 0;  // K, shown as grey level 0 and 255
  cv::Mat pattern_k;                // CV_32FC1, K, slow and fixed pattern together
  bool shutter_closed = false;      // the image before was repeated
};

class ThermalCamera {
 public:
  struct Image {
    cv::Mat grey;   // CV_8UC1
    cv::Mat raw16;  // CV_16UC1
  };

  ThermalCamera(const CameraIntrinsics& camera, const ThermalSensor& sensor, std::uint64_t seed,
                bool shutter_events);

  // `temperature_k`: CV_32FC1, already blurred by the sensor's lag (Renderer).
  [[nodiscard]] Image expose(const cv::Mat& temperature_k, double since_last_s);

  [[nodiscard]] const ThermalTruth& truth() const { return truth_; }

 private:
  [[nodiscard]] bool shutter_closed(double since_last_s);
  void drift(double since_last_s);
  void flat_field();
  void adapt_gain(const cv::Mat& signal_k, double since_last_s);

  ThermalSensor sensor_;
  bool shutter_events_;
  Random random_;
  NoiseTable noise_;
  cv::Mat fixed_k_;                   // CV_32FC1, K
  cv::Mat slow_cells_k_;              // CV_32FC1, K, coarse grid
  double black_k_ = 0, white_k_ = 0;  // K, smoothed, before the jitter; equal until the first image
  double until_shutter_s_ = 0, hold_s_ = 0;
  ThermalTruth truth_;
  Image last_;
};

}  // namespace covey
