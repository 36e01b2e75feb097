// SPDX-License-Identifier: Apache-2.0
//
// Reads EuRoC/ASL folders: DIR/uavK/mav0/{cam0,imu0,state_groundtruth_estimate0}. Everything is
// checked once, here: whatever is wrong is one std::runtime_error that names file and line.
#pragma once

#include <filesystem>
#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/trajectory_file.h"
#include "estimator/config.h"
#include "estimator/measurements.h"
#include "frontend/camera.h"
#include "sim/recorded_flight.h"

namespace covey {

struct DroneFolder {
  std::string name;            // "uav0"
  std::filesystem::path mav0;  // the folder that holds cam0 and imu0
};

struct ImageEntry {
  TimeNs stamp_ns = 0;
  std::filesystem::path path;
};

// Strictly increasing stamps, at least two states. Where the file has none, velocities are
// differentiated and biases zero.
struct GroundTruth {
  std::vector<TrueState> states;
};

// A hole in the IMU stream, longer than five times the median period.
struct ImuGap {
  TimeNs from_ns = 0;
  TimeNs to_ns = 0;
};

struct Dataset {
  CameraIntrinsics camera;
  CameraExtrinsics extrinsics;
  bool thermal = false;     // the camera: by its sensor.yaml, or because its images have 16 bits
  double line_delay_s = 0;  // CameraCalibration's
  cv::Mat mask;  // CV_8UC1, from cam0/mask.png: zero where no scene is seen; may be empty
  ImuNoise imu_noise;
  std::vector<ImageEntry> images;  // stamps strictly increasing
  std::vector<ImuSample> imu;      // stamps strictly increasing
  std::optional<GroundTruth> ground_truth;
  std::vector<ImuGap> imu_gaps;
  std::vector<std::string> warnings;  // one line each, for a person to read
};

// The drones below `folder`, in natural order (uav2 before uav10). A folder with mav0 directly
// inside, or mav0 itself, is a team of one called "uav0".
[[nodiscard]] std::vector<DroneFolder> find_drones(const std::filesystem::path& folder);

// What people call it: the name of its folder, however the path is written.
[[nodiscard]] std::string dataset_name(const std::filesystem::path& folder);
// The same, with as many of the folders above each as tell it from the others. Throws
// std::runtime_error if one stands there twice.
[[nodiscard]] std::vector<std::string> dataset_names(
    const std::vector<std::filesystem::path>& folders);

[[nodiscard]] Dataset read_dataset(const std::filesystem::path& mav0);

// Where a dataset has its ground truth, if it has any.
[[nodiscard]] std::filesystem::path ground_truth_file(const std::filesystem::path& mav0);

// What sensor.yaml says of camera and IMU, and nothing they recorded.
[[nodiscard]] Dataset read_sensors(const std::filesystem::path& mav0);

// The parts, for those that need only one.
[[nodiscard]] std::vector<ImuSample> read_imu(const std::filesystem::path& csv);
[[nodiscard]] GroundTruth read_ground_truth(const std::filesystem::path& csv);

// Ground truth between two states: linear, slerp for attitude. Nothing outside the recording, and
// in holes of it.
[[nodiscard]] std::optional<TrueState> ground_truth_at(const GroundTruth& truth, TimeNs stamp_ns);
// The state whose stamp is closest.
[[nodiscard]] const TrueState& nearest_state(const GroundTruth& truth, TimeNs stamp_ns);
[[nodiscard]] StampedPoses to_trajectory(const GroundTruth& truth);

// The first that is not damaged. Throws what is wrong with the last, if all are.
[[nodiscard]] cv::Mat first_readable(const Dataset& dataset);

// Grey pixels, CV_8UC1 or CV_16UC1, of the camera's size; an error names the image.
[[nodiscard]] cv::Mat read_image(const ImageEntry& image, int width, int height);

// A dataset to be flown: it has images, and the first that can be read says whether they have 16
// bits. Throws std::runtime_error as read_dataset does, and where there are none.
[[nodiscard]] Dataset read_recording(const std::filesystem::path& mav0);

}  // namespace covey
