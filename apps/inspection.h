// SPDX-License-Identifier: Apache-2.0
//
// One drone's flight over its recording, looked at: what the tracker saw and followed. A thermal
// camera's flight is flown twice at once, on raw and on calibrated images, unless only raw ones are
// asked for.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <opencv2/core.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/config_file.h"
#include "apps/dataset.h"
#include "apps/pipeline.h"
#include "apps/progress.h"
#include "apps/run_files.h"
#include "apps/thermal_comparison.h"
#include "apps/trajectory_file.h"

namespace covey {

struct InspectionConfig {
  // How to fly; alone, whatever it says. With thermal.mode raw only over raw images.
  AgentConfig agent;
  int pictures = 4;  // evenly spread over the flight
  // Images at which the field is kept, as far as they show a scene, ascending; empty: twice a
  // second.
  std::vector<TimeNs> field_stamps;
};

// Share of an image's pixels by the logarithm of their Harris response (Harris and Stephens 1988).
struct CornerHistogram {
  static constexpr int kBins = 40;
  static constexpr double kLowest = -9, kHighest = -1;  // log10 of the response, grey levels 0..1
  std::array<double, kBins> shares{};                   // means over the images
  std::int64_t images = 0;

  void add(const cv::Mat& grey);
  [[nodiscard]] static double middle(int bin);
};
[[nodiscard]] std::vector<CornerRecord> corner_records(const CornerHistogram& raw,
                                                       const CornerHistogram& calibrated);

struct DrawnTrack {
  Eigen::Vector2d pixel = Eigen::Vector2d::Zero();
  TrackKind kind = TrackKind::kOpportunistic;
};

struct Picture {
  TimeNs stamp_ns = 0;
  cv::Mat grey;  // CV_8UC1, what the tracker saw
  std::vector<DrawnTrack> tracks;
};

// Of the newest image of a pipeline.
[[nodiscard]] Picture picture_of(const ImageResult& newest, Pipeline& pipeline);
// Of `pictures` moments, evenly over the flight, neither its first nor its last image.
[[nodiscard]] std::vector<std::size_t> picture_indices(std::size_t images, int pictures);

struct InspectedFlight {
  std::vector<Picture> pictures;
  CornerHistogram corners;
  std::vector<Eigen::Vector2d> tracks;  // s since the first image, number of tracks
  double mean_tracks = 0, mean_length = 0;
  int repeated_images = 0, uniform_images = 0, filter_restarts = 0;
  StampedPoses path;  // empty when the filter never started
};

struct Inspection {
  Dataset dataset;
  std::uint64_t left_out = 0;  // images that cannot be read
  InspectedFlight raw;
  std::optional<InspectedFlight> calibrated;  // of a thermal camera, unless only raw
  std::vector<PhotometricRecord> gains;       // one for each image that showed a scene
  std::vector<FieldRecord> fields;            // only the last as large as images
  std::optional<double> pixel_lag_s;          // time constant, as estimated at the end
  std::optional<double> pattern_share;        // of the images, whose gain the sensor's pattern told
  // |difference| between a track's patch, its mean, and that ten images before, in standard
  // deviations of the image, median over the flight; of the same patches in raw and in calibrated
  // levels. Patches are warped with their tracks: the same piece of the scene.
  std::optional<double> raw_residual, calibrated_residual;
};

// Throws std::runtime_error naming file and line of a recording that cannot be read, or when a stop
// was requested.
[[nodiscard]] Inspection inspect_flight(const DroneFolder& drone, const InspectionConfig& config,
                                        const OnImage& show);

}  // namespace covey
