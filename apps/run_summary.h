// SPDX-License-Identifier: Apache-2.0
//
// summary.json: the figures of one run, for people and scripts. Schema 1. A figure that does not
// apply is null there and empty here. And what a drone's own summary says of its camera.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/evaluation.h"
#include "apps/run_files.h"
#include "apps/trajectory_file.h"

namespace covey {

struct AteSummary {
  double rmse = 0, mean = 0, std = 0;  // m
  std::optional<double> scale;         // sim3 only
};

struct AccuracySummary {
  AteSummary none, posyaw, se3, sim3;
  double rotation_none_deg = 0, rotation_posyaw_deg = 0, rotation_se3_deg = 0;  // rmse
  std::optional<double> nees_position, nees_orientation;
};

// Means per frame, ms. Empty: the stage did not run.
struct StageSummary {
  std::optional<double> thermal, track, describe, place, match, propagate, msckf, slam, peer;
};

struct RequestSummary {
  std::int64_t sent = 0, received = 0, payload_bytes_sent = 0;
};

struct MessageSummary {
  std::int64_t sent = 0, received = 0, payload_bytes_sent = 0;
  std::int64_t fused = 0, gated = 0, rejected = 0;
};

// A peer's wall clock minus the own one, sure to half the round trip.
struct ClockSummary {
  double clock_offset_ms = 0, round_trip_ms = 0;
};

[[nodiscard]] nlohmann::json to_json(const std::map<std::string, ClockSummary>& clocks);

struct LinkSummary {
  RequestSummary request;
  MessageSummary message;
  std::optional<std::int64_t> wire_bytes_sent, wire_bytes_received;
  // By peer; the key exists only where statuses went both ways.
  std::map<std::string, ClockSummary> clocks;
  // How often its process was started anew, by reason; the key exists only if it was.
  std::map<std::string, std::int64_t> restarts;
};

[[nodiscard]] std::int64_t restart_count(const LinkSummary& link);

// A peer's world in the own one, against the truth.
struct AlignmentSummary {
  double position_error_m = 0, yaw_error_deg = 0;
  double position_sigma_m = 0, yaw_sigma_deg = 0;  // as the drone itself says
};

struct AgentSummary {
  std::int64_t frames = 0, frames_dropped = 0;
  std::optional<double> initialised_after_s;
  // Why it has not started by the end; the key exists only then.
  std::optional<std::string> not_started;
  std::optional<double> distance_m;         // of the truth, or of the estimate without one
  std::optional<AccuracySummary> accuracy;  // empty without ground truth
  std::optional<double> cpu_ms_per_frame, max_rss_mib, max_cpu_percent;  // with the link's process
  StageSummary stage_ms;
  std::optional<double> mean_tracks_per_frame, mean_track_length;
  std::optional<LinkSummary> link;  // empty when flown alone
  // By peer, when drones started in worlds of their own; the key exists only then.
  std::optional<std::map<std::string, AlignmentSummary>> alignments;
  // Why the flight ended before the recording did; the key exists only then.
  std::optional<std::string> incomplete;
  LostLines lost_lines;  // the key exists only if there are any
};

struct RunSummary {
  std::string dataset;
  std::string mode;                     // "collaborative" or "solo"
  std::optional<std::string> exchange;  // "compact", "paper" or "naive"; empty when solo
  std::string init;                     // "static" or "groundtruth"
  std::optional<double> real_time_factor;
  std::map<std::string, AgentSummary> agents;
};

// What was found in flight, minus what was believed at its start. The three are of one size; sigmas
// are zero where nothing was calibrated.
struct CalibrationChange {
  Eigen::VectorXd difference, sigma, sigma_at_start;
};

struct CameraChanges {
  CalibrationChange time_offset_s;                         // one number
  CalibrationChange rotation_deg;                          // about the camera's x, y and z
  CalibrationChange p_imu_cam_m;                           // x y z
  CalibrationChange focal_lengths_px, principal_point_px;  // x y
  CalibrationChange k1, k2;
};

[[nodiscard]] nlohmann::json to_json(const AgentSummary& agent);
[[nodiscard]] nlohmann::json to_json(const RunSummary& run);
// `where` names the source in errors: a missing key, or one of another type, is an error.
[[nodiscard]] AgentSummary agent_summary_from_json(const nlohmann::json& json,
                                                   const std::string& where);
[[nodiscard]] RunSummary run_summary_from_json(const nlohmann::json& json,
                                               const std::string& where);

void write_run_summary(const std::filesystem::path& file, const RunSummary& run);
[[nodiscard]] RunSummary read_run_summary(const std::filesystem::path& file);
// From a drone's agent_summary.json; empty if it does not say what was believed at the start.
[[nodiscard]] std::optional<CameraChanges> read_camera_changes(
    const std::filesystem::path& agent_summary);

// Every figure that follows from an estimate and its ground truth. Throws when they do not overlap.
[[nodiscard]] AccuracySummary summarize_accuracy(const StampedPoses& estimate,
                                                 const StampedPoses& truth,
                                                 const std::vector<StampedCovariance>& covariances);
// Means of the stages that took any time at all.
[[nodiscard]] StageSummary summarize_stages(const std::vector<TimingRecord>& timings);

}  // namespace covey
