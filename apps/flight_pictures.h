// SPDX-License-Identifier: Apache-2.0
//
// A few moments of a calibrated thermal flight over a recording, for its report: kept while it is
// flown, drawn and written at its end, where they keep no image waiting.
#pragma once

#include <cstddef>
#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "apps/dataset.h"
#include "apps/inspection.h"
#include "apps/pipeline.h"
#include "estimator/measurements.h"

namespace covey {

class FlightPictures {
 public:
  // Of a recording with these images; without any nothing is ever due.
  explicit FlightPictures(const std::vector<ImageEntry>& images);

  // At an image that shows a scene: a moment at which the camera does not see is pictured as soon
  // as it does.
  [[nodiscard]] bool is_due(TimeNs stamp_ns) const;
  // `raw`: CV_8UC1, before calibration.
  void add(cv::Mat raw, Picture calibrated);

  // Into a drone's folder: kPicturesFile and kCornersFile, or nothing where nothing was pictured.
  // Throws std::runtime_error naming what cannot be written. `mask`: Dataset's.
  void write(const std::filesystem::path& folder, const cv::Mat& mask) const;

 private:
  struct Moment {
    cv::Mat raw;
    Picture calibrated;
  };
  std::vector<TimeNs> stamps_;  // from when on a moment is due
  std::vector<Moment> moments_;
};

}  // namespace covey
