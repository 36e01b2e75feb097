// SPDX-License-Identifier: Apache-2.0
//
// Writes EuRoC/ASL folders. Everything goes into a folder beside the final one, which is renamed at
// the very end: a dataset is whole or it is not there.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "estimator/config.h"
#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "sim/recorded_flight.h"

namespace covey {

// Whether a folder is one that may be replaced: nobody's own files go.
using IsReplaceable = bool (*)(const std::filesystem::path&);
// Nothing but what a simulation has written: recordings, and files that somebody put in, are not.
[[nodiscard]] bool is_simulated(const std::filesystem::path& folder);

class StagedFolder {
 public:
  // Throws std::runtime_error when `target` exists, unless it is an empty folder or passes the
  // test, or nothing can be written there. Links stay and what they lead to is replaced.
  // `way_out`: what is advised then.
  explicit StagedFolder(std::filesystem::path target, IsReplaceable is_replaceable = nullptr,
                        std::string way_out = "choose another --out or --force");
  ~StagedFolder();  // removes what was not committed
  StagedFolder(const StagedFolder&) = delete;
  StagedFolder& operator=(const StagedFolder&) = delete;

  [[nodiscard]] const std::filesystem::path& path() const { return staging_; }
  // Throws std::runtime_error when something has come into the target meanwhile that may not be
  // replaced.
  void commit();

 private:
  std::filesystem::path name_;  // as it was given
  std::filesystem::path target_, staging_;
  IsReplaceable is_replaceable_;
  std::string way_out_;
};

struct CameraDescription {
  CameraIntrinsics intrinsics;
  CameraExtrinsics extrinsics;
  double rate_hz = 30;
  // s, by which each row of pixels looks later than the one above it: a rolling shutter. 0: all at
  // once. Stamps are of the middle row.
  double line_delay_s = 0;
  std::string comment;
};

// sensor.yaml of cam0, as EuRoC writes it. T_BS takes sensor to body coordinates.
void write_camera_file(const std::filesystem::path& file, const CameraDescription& camera);
void write_imu_file(const std::filesystem::path& file, const ImuNoise& noise, double rate_hz,
                    const std::string& comment);
void write_imu_csv(const std::filesystem::path& file, const std::vector<ImuSample>& samples);
void write_ground_truth_csv(const std::filesystem::path& file,
                            const std::vector<TrueState>& states);

// The images of one camera folder: names the files, keeps data.csv in step with them.
class ImageList {
 public:
  explicit ImageList(const std::filesystem::path& camera_folder);

  // Where the image of this stamp belongs; it appears in data.csv at once.
  [[nodiscard]] std::filesystem::path add(TimeNs stamp_ns);
  // Throws when data.csv could not be written whole.
  void close();

 private:
  std::filesystem::path folder_;
  std::ofstream csv_;
};

}  // namespace covey
