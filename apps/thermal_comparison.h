// SPDX-License-Identifier: Apache-2.0
//
// What calibration found out about a thermal camera against what the simulator did.
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <vector>

#include "apps/run_files.h"
#include "apps/thermal_truth_file.h"
#include "estimator/measurements.h"
#include "frontend/temporal_gain.h"

namespace covey {

struct FieldRecord {
  TimeNs stamp_ns = 0;
  TimeNs chain_ns = 0;
  // CV_32FC1, as large as the image or in cells of the truth; grey levels of the chain's first
  // image.
  cv::Mat field;
};

// |estimated over true - 1|.
struct GainErrors {
  double mean = 0, worst = 0;
};

struct ThermalComparison {
  // Of the gain between images of one chain, a third of a second, a second and the chain so far
  // apart. Empty when there are no such images.
  std::optional<GainErrors> third, second, chain;
  // Of the gains of a chain, but for one factor that all of them share: which image a chain's gains
  // are told against is arbitrary, and its own error is then in all of them.
  std::optional<GainErrors> within_chain;
  // Of the field, its mean taken off, over that of the truth; mean over what was compared once
  // the chain is two seconds old. The same with the best plane taken off both: the slope along a
  // flow that is the same everywhere cannot be seen.
  std::optional<double> field_rms, field_rms_without_slope;
  std::vector<PhotometricRecord> true_gains;    // of the images compared
  std::vector<Eigen::Vector2d> field_rms_over;  // stamp [s since the first record], RMS ratio
  std::optional<double> true_field_k;           // K, RMS of the true field, mean of the same
};

// Images of 16 bits show temperatures as they are, `kelvin_per_count` each.
[[nodiscard]] ThermalComparison compare_with_truth(const std::vector<PhotometricRecord>& gains,
                                                   const std::vector<FieldRecord>& fields,
                                                   const std::vector<ThermalTruthRecord>& truth,
                                                   std::optional<double> kelvin_per_count);

}  // namespace covey
