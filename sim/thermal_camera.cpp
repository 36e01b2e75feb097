// SPDX-License-Identifier: Apache-2.0
#include "sim/thermal_camera.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

namespace covey {
namespace {

// Temperatures below which the given shares of the pixels lie.
std::pair<double, double> percentiles(const cv::Mat& signal_k, double low, double high) {
  double least = 0, most = 0;
  cv::minMaxLoc(signal_k, &least, &most);
  constexpr int kBins = 2048;
  std::array<int, kBins> histogram{};
  const float scale = static_cast<float>((kBins - 1) / std::max(1e-6, most - least));
  for (int y = 0; y < signal_k.rows; y += 2) {
    const float* row = signal_k.ptr<float>(y);
    for (int x = 0; x < signal_k.cols; x += 2)
      ++histogram[static_cast<std::size_t>((row[x] - static_cast<float>(least)) * scale)];
  }
  const int total = ((signal_k.rows + 1) / 2) * ((signal_k.cols + 1) / 2);
  const auto at = [&](double share) {
    double sum = 0;
    for (int bin = 0; bin < kBins; ++bin)
      if ((sum += histogram[static_cast<std::size_t>(bin)]) >= share * total)
        return least + bin / static_cast<double>(scale);
    return most;
  };
  return {at(low), at(high)};
}

}  // namespace

ThermalCamera::ThermalCamera(const CameraIntrinsics& camera, const ThermalSensor& sensor,
                             std::uint64_t seed, bool shutter_events)
    : sensor_(sensor),
      shutter_events_(shutter_events),
      random_(seed, 307),
      noise_(seed),
      fixed_k_(camera.height, camera.width, CV_32FC1),
      slow_cells_k_((sensor.nonuniformity_cells * camera.height + camera.width - 1) / camera.width,
                    sensor.nonuniformity_cells, CV_32FC1) {
  std::vector<double> columns(static_cast<std::size_t>(camera.width));
  for (double& column : columns) column = sensor.fixed_column_k * random_.gaussian();
  for (int y = 0; y < camera.height; ++y) {
    const double row = sensor.fixed_row_k * random_.gaussian();
    for (int x = 0; x < camera.width; ++x)
      fixed_k_.at<float>(y, x) = static_cast<float>(row + columns[static_cast<std::size_t>(x)] +
                                                    sensor.fixed_pixel_k * random_.gaussian());
  }
  for (int i = 0; i < static_cast<int>(slow_cells_k_.total()); ++i)
    slow_cells_k_.at<float>(i / slow_cells_k_.cols, i % slow_cells_k_.cols) =
        static_cast<float>(sensor.nonuniformity_k * random_.gaussian());
  until_shutter_s_ = sensor.shutter_interval_s * random_.uniform(0.4, 0.8);
}

// Each cell is an Ornstein-Uhlenbeck process: it wanders, but stays as large as it was.
void ThermalCamera::drift(double since_last_s) {
  const double keep = std::exp(-since_last_s / sensor_.nonuniformity_drift_s);
  const double fresh = sensor_.nonuniformity_k * std::sqrt(1 - keep * keep);
  for (int y = 0; y < slow_cells_k_.rows; ++y)
    for (int x = 0; x < slow_cells_k_.cols; ++x) {
      float& cell = slow_cells_k_.at<float>(y, x);
      cell = static_cast<float>(keep * cell + fresh * random_.gaussian());
    }
}

// The camera looks at its shutter: the slow pattern nearly vanishes, and the gain starts afresh.
void ThermalCamera::flat_field() {
  slow_cells_k_ *= 0.15;
  const double shift = random_.uniform(-0.15, 0.15) * (white_k_ - black_k_);
  black_k_ += shift;
  white_k_ += shift + random_.uniform(0.0, 0.2) * (white_k_ - black_k_);
  until_shutter_s_ = sensor_.shutter_interval_s * random_.uniform(0.7, 1.3);
}

bool ThermalCamera::shutter_closed(double since_last_s) {
  if (!shutter_events_ || last_.grey.empty()) return false;
  if (hold_s_ > 0) {
    hold_s_ -= since_last_s;
    if (hold_s_ > 0) return true;
    flat_field();
    return false;
  }
  until_shutter_s_ -= since_last_s;
  if (until_shutter_s_ > 0) return false;
  hold_s_ = sensor_.shutter_hold_s;
  return true;
}

void ThermalCamera::adapt_gain(const cv::Mat& signal_k, double since_last_s) {
  auto [black, white] = percentiles(signal_k, sensor_.agc_low, sensor_.agc_high);
  const double missing = std::max(0.0, sensor_.min_range_k - (white - black));
  black -= missing / 2;
  white += missing / 2;
  const bool first = white_k_ <= black_k_;
  const double step = first ? 1.0 : 1 - std::exp(-since_last_s / sensor_.agc_smoothing_s);
  black_k_ += step * (black - black_k_);
  white_k_ += step * (white - white_k_);
  const double jitter_k = sensor_.agc_jitter * (white_k_ - black_k_);
  truth_.black_k = black_k_ + jitter_k * random_.gaussian();
  truth_.white_k = white_k_ + jitter_k * random_.gaussian();
}

ThermalCamera::Image ThermalCamera::expose(const cv::Mat& temperature_k, double since_last_s) {
  drift(since_last_s);
  truth_.shutter_closed = shutter_closed(since_last_s);
  if (truth_.shutter_closed) return {last_.grey.clone(), last_.raw16.clone()};

  cv::Mat pattern;
  cv::resize(slow_cells_k_, pattern, temperature_k.size(), 0, 0, cv::INTER_CUBIC);
  truth_.pattern_k = pattern + fixed_k_;
  cv::Mat signal = temperature_k + truth_.pattern_k;
  for (int y = 0; y < signal.rows; ++y) {
    float* row = signal.ptr<float>(y);
    const float* noise = noise_.next_row();
    for (int x = 0; x < signal.cols; ++x) row[x] += static_cast<float>(sensor_.netd_k) * noise[x];
  }
  adapt_gain(signal, since_last_s);
  const double gain = 255.0 / (truth_.white_k - truth_.black_k);
  signal.convertTo(last_.grey, CV_8UC1, gain, -gain * truth_.black_k);
  signal.convertTo(last_.raw16, CV_16UC1, 1.0 / sensor_.raw_k_per_count);
  return {last_.grey.clone(), last_.raw16.clone()};
}

}  // namespace covey
