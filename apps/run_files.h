// SPDX-License-Identifier: Apache-2.0
//
// What one drone leaves in RUN/<agent>/ besides the summary, one writer and one reader for each
// file:
//
//   trajectory.tum             t x y z qx qy qz qw; the IMU in the world at every image after start
//   trajectory_covariance.csv  stamp_ns and the upper triangle of the 6x6 covariance of [dp dtheta]
//   groundtruth.tum            the drone's ground truth, if its dataset has one (write_tum)
//   timings.csv                one line per image: time of each stage, counts
//   link.csv                   one line per image: what went over the link so far
//   exchange.csv               one line per question and answer: when it was sent or handled
//   thermal.csv                one line per image of a calibrated thermal camera: gain and offset
//   thermal_field.csv          its additive field at the end, row by row, grey levels
//   thermal_pictures.png       of a recording, a few moments: raw, calibrated, tracks by kind
//   thermal_corners.csv        at these moments: how strongly corners respond, raw and calibrated
//
// A run with a reference flown alone keeps that in RUN/solo/<agent>/, in the same files.
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <opencv2/core/mat.hpp>
#include <string>
#include <vector>

#include "apps/csv.h"
#include "apps/trajectory_file.h"
#include "estimator/measurements.h"
#include "frontend/temporal_gain.h"

namespace covey {

inline constexpr char kTrajectoryFile[] = "trajectory.tum";
inline constexpr char kCovarianceFile[] = "trajectory_covariance.csv";
inline constexpr char kGroundTruthFile[] = "groundtruth.tum";
inline constexpr char kTimingsFile[] = "timings.csv";
inline constexpr char kLinkFile[] = "link.csv";
inline constexpr char kExchangeFile[] = "exchange.csv";
inline constexpr char kThermalFile[] = "thermal.csv";
inline constexpr char kFieldFile[] = "thermal_field.csv";
inline constexpr char kPicturesFile[] = "thermal_pictures.png";
inline constexpr char kCornersFile[] = "thermal_corners.csv";
// All of them: what is taken away before a drone flies anew.
inline constexpr const char* kRunFiles[] = {
    kTrajectoryFile, kCovarianceFile, kGroundTruthFile, kTimingsFile,  kLinkFile,
    kExchangeFile,   kThermalFile,    kFieldFile,       kPicturesFile, kCornersFile};
inline constexpr char kSoloFolder[] = "solo";

// One image: milliseconds of CPU time per stage, then counts.
struct TimingRecord {
  TimeNs stamp_ns = 0;
  double read_ms = 0, thermal_ms = 0, track_ms = 0, describe_ms = 0, place_ms = 0, match_ms = 0;
  double propagate_ms = 0, msckf_ms = 0, slam_ms = 0, peer_ms = 0, total_ms = 0;
  std::int64_t tracks = 0, slam_features = 0, clones = 0;
  std::int64_t msckf_used = 0, msckf_gated = 0, slam_used = 0, slam_gated = 0;
};

// Totals since the start.
struct LinkRecord {
  TimeNs stamp_ns = 0;
  std::int64_t requests_sent = 0, requests_received = 0;
  std::int64_t messages_sent = 0, messages_received = 0;
  std::int64_t fused = 0, gated = 0, rejected = 0;
  std::int64_t payload_bytes_sent = 0;
};

enum class ExchangeEvent {
  kAsked,     // all peers
  kHeard,     // the peer's question
  kAnswered,  // the peer, or all of them where nobody asks
  kFused,     // the peer's answer; so the next two
  kGated,
  kRejected,
  kTold,     // back to the peer what came of its answer
  kLearned,  // from the peer what came of the own answer
};

struct ExchangeRecord {
  double clock_ms = 0;  // steady_ms(): one clock for all processes of a machine
  ExchangeEvent event = ExchangeEvent::kAsked;
  std::string peer;               // kEveryPeer: all of them
  std::uint64_t keyframe_id = 0;  // of the question, whoever's; of the answer where nobody asked
};
inline constexpr char kEveryPeer[] = "*";

struct PhotometricRecord {
  TimeNs stamp_ns = 0;
  TimeNs chain_ns = 0;  // the first image of its chain
  GainOffset map;       // grey levels to those of that image
};

// Shares of an image's pixels whose Harris response lies about there.
struct CornerRecord {
  double log10_response = 0;
  double raw = 0, calibrated = 0;
};

// How many lines a full disk has kept out of each file; of those from which it has kept any.
using LostLines = std::map<std::string, std::int64_t>;

// trajectory.tum and trajectory_covariance.csv of one drone, in `folder`.
class OdometryWriter {
 public:
  explicit OdometryWriter(const std::filesystem::path& folder);
  void write(const Odometry& odometry);
  [[nodiscard]] LostLines lost_lines() const;

 private:
  LineWriter trajectory_;
  LineWriter covariance_;
};

// One line for each record, in the file of its kind.
template <typename Record>
class RunFileWriter {
 public:
  explicit RunFileWriter(const std::filesystem::path& folder);
  void write(const Record& record);
  [[nodiscard]] LostLines lost_lines() const;

 private:
  LineWriter file_;
};
using TimingWriter = RunFileWriter<TimingRecord>;
using LinkWriter = RunFileWriter<LinkRecord>;
using ExchangeWriter = RunFileWriter<ExchangeRecord>;
using ThermalWriter = RunFileWriter<PhotometricRecord>;

// 40 cells across, each the mean of what lies in it. `field`: CV_32FC1.
void write_field(const std::filesystem::path& folder, const cv::Mat& field);
void write_corners(const std::filesystem::path& folder, const std::vector<CornerRecord>& corners);

// Columns are found by their names in the header line; a missing one is an error that names it.
[[nodiscard]] std::vector<TimingRecord> read_timings(const std::filesystem::path& file);
[[nodiscard]] std::vector<LinkRecord> read_link(const std::filesystem::path& file);
[[nodiscard]] std::vector<ExchangeRecord> read_exchange(const std::filesystem::path& file);
[[nodiscard]] std::vector<PhotometricRecord> read_thermal(const std::filesystem::path& file);
[[nodiscard]] cv::Mat read_field(const std::filesystem::path& file);  // CV_32FC1
[[nodiscard]] std::vector<CornerRecord> read_corners(const std::filesystem::path& file);

extern template class RunFileWriter<TimingRecord>;
extern template class RunFileWriter<LinkRecord>;
extern template class RunFileWriter<ExchangeRecord>;
extern template class RunFileWriter<PhotometricRecord>;

}  // namespace covey
