// SPDX-License-Identifier: Apache-2.0
//
// What a simulated thermal camera did to the temperatures, beside its images, for calibrations to
// be compared with: DIR/uavK/mav0/thermal_truth0/
//
//   data.csv         stamp [ns], temperature shown as black and as white [K], shutter closed 0/1,
//                    file of the additive field or -
//   data/STAMP.png   the field twice a second, mean of each square of 16 px, 16 bits, 1 mK per
//                    count, 0 K is 32768
//
// Recorded flights have none of it.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apps/csv.h"
#include "estimator/measurements.h"
#include "sim/thermal_camera.h"

namespace covey {

inline constexpr char kThermalTruthFolder[] = "thermal_truth0";
inline constexpr int kTruthCell = 16;  // px, side of a square of the field

class ThermalTruthWriter {
 public:
  // Makes the folder.
  explicit ThermalTruthWriter(const std::filesystem::path& mav0);
  void write(TimeNs stamp_ns, const ThermalTruth& truth);
  void close();

 private:
  std::filesystem::path folder_;
  LineWriter csv_;
  TimeNs next_field_ns_ = 0;
};

// Of one image. Grey level g shows the temperature black_k + g/255 (white_k - black_k).
struct ThermalTruthRecord {
  TimeNs stamp_ns = 0;
  double black_k = 0, white_k = 0;  // K
  bool shutter_closed = false;
  std::filesystem::path field;  // empty when none was written for this image
};

// Of a field as large as the image the mean of each square, as it is kept here.
[[nodiscard]] cv::Mat in_truth_cells(const cv::Mat& field);

// Nothing when the recording has none. Throws std::runtime_error that names file and line.
[[nodiscard]] std::optional<std::vector<ThermalTruthRecord>> read_thermal_truth(
    const std::filesystem::path& mav0);

// Of the images for which a field was written.
[[nodiscard]] std::vector<TimeNs> field_stamps(const std::vector<ThermalTruthRecord>& truth);

// CV_32FC1, K, one value for each square.
[[nodiscard]] cv::Mat read_true_field(const std::filesystem::path& file);

}  // namespace covey
