// SPDX-License-Identifier: Apache-2.0
//
// Everything that can be set in one drone's program, as one JSON file with a section per module.
// Keys that are not given keep their defaults; a key that is not known, or whose value has another
// type or lies out of range, is an error that names key and file.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <filesystem>
#include <nlohmann/json_fwd.hpp>
#include <string>

#include "apps/config_visitor.h"
#include "apps/link_profiles.h"
#include "comms/onboard_link.h"
#include "comms/peer_link.h"
#include "estimator/config.h"
#include "estimator/drift_filter.h"
#include "frontend/collaborator.h"
#include "frontend/lag_estimator.h"
#include "frontend/photometric_calibration.h"
#include "frontend/tracker.h"

namespace covey {

enum class FlightMode { kCollaborative, kSolo };

enum class Pace {
  kMax,       // as fast as the machine can
  kLockstep,  // a team says how far to go; nothing depends on the machine's load
  kRate,      // real_time_factor times real time; late frames are dropped
  kLive,      // no recording: camera and IMU say what they see over DDS (onboard_link.h)
};

struct AgentSettings {
  std::string name = "uav0";
  std::string dataset;     // folder that holds cam0 and imu0; of a live flight, their sensor.yaml
  std::string vocabulary;  // of places, see load_vocabulary; empty: what suits the camera
  std::string out;         // folder for the drone's files; made if it does not exist
  FlightMode mode = FlightMode::kCollaborative;
  Pace pace = Pace::kMax;
  double real_time_factor = 1;  // for Pace::kRate
  int image_queue = 4;          // images that wait, kRate and kLive; the oldest is dropped
  double duration_s = 0;        // s to fly; 0: all of the recording, or until stopped
  int wait_for_peers = 0;       // drones to be in touch with before the start; not of kLive
  double peer_timeout_s = 30;   // s; then the drone flies without them
};

enum class InitMethod { kStatic, kGroundTruth };

struct InitialisationConfig {
  InitMethod method = InitMethod::kGroundTruth;
  double position_sigma = 1e-3;   // m
  double yaw_sigma = 5e-4;        // rad
  double tilt_sigma = 5e-4;       // rad, of a start from ground truth
  double velocity_sigma = 0.02;   // m/s
  double gyro_bias_sigma = 0.05;  // rad/s: recorded IMUs show up to 0.08
  double accel_bias_sigma = 0.1;  // m/s2
  // Static starts without ground truth.
  Eigen::Vector3d p_world_imu = Eigen::Vector3d::Zero();  // m
  double yaw = 0;                                         // rad
  // Start at the origin of a world of the own, with yaw 0, wherever that is for the others.
  bool own_world = false;
};

enum class FusionMode {
  kJoint,             // a small filter over all drones' drift (drift_filter.h)
  kIntersectedState,  // the paper's: peers' landmarks correct the own filter by covariance
                      // intersection
};

// How well the starts of drones in one world are known to each other.
enum class KnownStarts {
  kAuto,      // exactly where ground truth tells, else as they were measured
  kExact,     // as they are told
  kMeasured,  // as well as FusionConfig says
};

struct FusionConfig {
  FusionMode mode = FusionMode::kJoint;
  DriftConfig drift;
  KnownStarts starts = KnownStarts::kAuto;
  // Where they are measured, by hand, say; standard deviations between two drones.
  double start_position_sigma_m = 0.1;          // m
  double start_yaw_sigma = 2.0 / 180.0 * M_PI;  // rad
};
// What of it the drift filter takes. `has_truth`: does ground truth say where this drone starts?
[[nodiscard]] DriftConfig drift_config(const FusionConfig& fusion, bool has_truth);

enum class ThermalMode {
  kAuto,        // calibrated when the camera is a thermal one, by sensor.yaml or 16-bit images
  kRaw,         // images as they are; 16-bit ones stretched to what each holds
  kCalibrated,  // the camera is a thermal one, whatever sensor.yaml says
};
[[nodiscard]] std::optional<ThermalMode> thermal_mode_from_name(const std::string& name);
// `named`: by sensor.yaml or 16-bit images.
[[nodiscard]] bool is_thermal_camera(ThermalMode mode, bool named);
[[nodiscard]] bool is_calibrated(ThermalMode mode, bool named);

struct ThermalConfig {
  ThermalMode mode = ThermalMode::kAuto;
  // Of a thermal camera's pixels: images stamped when they are read out show the past by so much.
  // Zero for drivers that account for it, as our simulator does. A few ms are found in flight
  // (EstimatorConfig::calibrate_time_offset).
  double time_constant_s = 0;
  PixelLagConfig pixel_lag;  // taken out of calibrated images
  // As TrackerConfig has it for other images. Pixels that lag and a pattern that stands still do
  // not show in how well a patch fits.
  double aligned_scale = 7;
  // As EstimatorConfig has it for other cameras: their tracks leave less to be taken for the IMU's.
  double imu_noise_scale = 1.4;
  PhotometricConfig photometric;
};

// What sensor.yaml says of the camera is about right, and gets better in flight; what it says of
// the IMU's noise is too little (docs/accuracy.md).
[[nodiscard]] EstimatorConfig estimator_in_flight();

struct AgentConfig {
  AgentSettings agent;
  InitialisationConfig initialisation;
  ThermalConfig thermal;
  TrackerConfig tracker;
  // imu_noise and extrinsics are the dataset's, from sensor.yaml.
  EstimatorConfig estimator = estimator_in_flight();
  CollaboratorConfig collaboration;
  FusionConfig fusion;
  OnboardConfig onboard;  // of a live flight
  LinkConfig link;        // its profile is the one that is chosen here:
  ProfileChoice link_profile;
};

// Shows every key of `config` to `visitor` (config_schema.cpp).
void visit_config(AgentConfig& config, ConfigVisitor& visitor);

// Sets in `config` what `json` holds; `file` is named in errors.
void merge_config(const nlohmann::json& json, const std::string& file, AgentConfig& config);

[[nodiscard]] AgentConfig read_config(const std::filesystem::path& file);

// The link of this drone, as its settings want it.
[[nodiscard]] LinkConfig link_config(const AgentConfig& config);

// What it hears and says aboard, in a live flight.
[[nodiscard]] OnboardConfig onboard_config(const AgentConfig& config);

// What this drone's side of the exchange is set to. `has_truth`: as for drift_config().
[[nodiscard]] CollaboratorConfig collaborator_config(const AgentConfig& config, bool has_truth);

// Throws std::runtime_error for settings that contradict each other, which name both keys.
void require_possible(const AgentConfig& config);

[[nodiscard]] std::string print_config(const AgentConfig& config);  // JSON
// One line per key: key, default, range, meaning and unit.
[[nodiscard]] std::string describe_config();

}  // namespace covey
