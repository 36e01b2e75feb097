// SPDX-License-Identifier: Apache-2.0
//
// Everything the report shows of one run, read from its folder. What is missing stays empty and is
// said in `notes`.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/evaluation.h"
#include "apps/run_files.h"
#include "apps/run_summary.h"
#include "apps/trajectory_file.h"

namespace covey {

struct AgentRun {
  std::string name;
  AgentSummary summary;
  std::optional<CameraChanges> camera;  // empty in runs of earlier versions
  StampedPoses estimate;
  StampedPoses alone;  // flown without the others, RUN/solo
  StampedPoses truth;  // during this run only
  std::vector<StampedCovariance> covariances;
  std::vector<TimingRecord> timings;
  std::vector<LinkRecord> link;
  std::vector<PhotometricRecord> thermal;
  cv::Mat field;  // CV_32FC1, coarse, at the end; empty unless a thermal camera was calibrated
  std::string pictures;  // kPicturesFile as it lies there; empty without one
  std::vector<CornerRecord> corners;
  // The estimates with their truth; empty without one.
  std::vector<PosePair> pairs;
  std::vector<PosePair> alone_pairs;
  std::optional<AccuracySummary> accuracy;
  std::optional<AccuracySummary> alone_accuracy;
  TimeNs first_ns = 0, last_ns = 0;  // of its own flight
  // Of its time axes: from the first image of any drone to the last, or of its own flight.
  TimeNs start_ns = 0, end_ns = 0;
  bool time_of_its_own = false;
};

struct RunData {
  RunSummary summary;
  std::vector<AgentRun> agents;  // in the order of the summary
  TimeNs start_ns = 0;           // the first image of any drone
  TimeNs end_ns = 0;
  bool apart = false;  // the drones flew at times so far apart that none would be seen on one axis
  std::vector<std::string> notes;
};

// How long it flew; nothing if it did not.
[[nodiscard]] std::optional<double> flown_s(const AgentRun& agent);

// Throws when there is no summary.json that can be read.
[[nodiscard]] RunData read_run(const std::filesystem::path& run);

}  // namespace covey
