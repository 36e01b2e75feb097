// SPDX-License-Identifier: Apache-2.0
//
// One drone, one process: a recording or its own sensors in, odometry and messages out.
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "apps/config_file.h"
#include "apps/control_channel.h"
#include "apps/dataset.h"
#include "apps/flight_counts.h"
#include "apps/flight_pictures.h"
#include "apps/flight_warnings.h"
#include "apps/pipeline.h"
#include "apps/process_usage.h"
#include "apps/run_files.h"
#include "apps/run_summary.h"
#include "apps/status_file.h"
#include "comms/link.h"
#include "comms/onboard_link.h"

namespace covey {

// What an agent leaves beside the files of run_files.h.
inline constexpr char kAgentConfigFile[] = "config.json";
inline constexpr char kAgentSummaryFile[] = "agent_summary.json";
inline constexpr char kAgentStatusFile[] = "status.json";  // once a second, and at the end

// Whether a drone tells the others its status again, after what it `told` last: at once when it
// changes, and now and then. That the drone is there the link says by itself.
[[nodiscard]] bool is_status_due(const std::optional<AgentStatus>& told, const AgentStatus& status);

// The drone itself: what its images and its peers' messages do to it and to its files. One thread.
class Agent {
 public:
  // Flies a recording. Reads it, opens the link and the files. Throws std::runtime_error.
  explicit Agent(const AgentConfig& config);
  // Flies what it is given, with sensors as `sensors` has them, and tells `onboard`, which outlives
  // it, where it is.
  Agent(const AgentConfig& config, Dataset sensors, OnboardLink& onboard);

  [[nodiscard]] const AgentConfig& config() const { return config_; }
  [[nodiscard]] const std::vector<ImageEntry>& images() const { return dataset_.images; }
  [[nodiscard]] const std::vector<std::string>& warnings() const { return dataset_.warnings; }
  [[nodiscard]] const CameraIntrinsics& camera() const { return dataset_.camera; }  // as recorded

  // Of a live flight, in time order. With them the motion is told, if that is to be more often than
  // at each image.
  void add_imu(const std::vector<ImuSample>& samples);
  // The IMU must have passed it when the image is flown.
  [[nodiscard]] TimeNs imu_moment(TimeNs image_ns) const { return pipeline_.imu_moment(image_ns); }

  // Images must come in time order; some may be left out.
  void fly(TimeNs stamp_ns, const cv::Mat& pixels, double read_ms);
  // So far.
  void set_dropped(std::uint64_t images) { counts_.dropped = static_cast<std::int64_t>(images); }

  // Peers. Nothing happens when flown alone.
  [[nodiscard]] bool meet(const std::set<std::string>& peers, std::chrono::milliseconds patience);
  [[nodiscard]] bool meet(std::size_t peers, std::chrono::milliseconds patience);
  [[nodiscard]] std::string words_on_peers(std::size_t expected) const;
  ArrivalCounts wait_for_arrivals(const ArrivalCounts& expected,
                                  std::chrono::milliseconds patience);
  void take_inbox();       // puts aside what has arrived
  void handle_messages();  // in the order of stamp and sender

  void show_status();  // in status.json, unless that was done within the last second
  // Why not, if it does not fly yet.
  [[nodiscard]] std::optional<std::string> not_started() const;
  [[nodiscard]] AdvancedReply progress() const;  // without the memory, which takes a while to ask
  [[nodiscard]] double own_memory_mib() const;   // with the link's process

  // Writes the last status and the summary. `incomplete`: why the flight ended early, if it did.
  AgentSummary finish(const std::optional<std::string>& incomplete = {});

 private:
  Agent(const AgentConfig& config, Dataset dataset, OnboardLink* onboard);
  void tell_predicted();
  void tell(const Odometry& odometry, const ImuSample& newest);
  void handle(const PlaceAdvert& advert);
  bool send(const PeerKeyframe& answer);
  void handle(const PeerKeyframe& keyframe);
  void count_answer(PeerOutcome outcome, const PeerKeyframe& keyframe);
  void handle(const FullPeerKeyframe& message) { handle(message.keyframe); }
  void handle(const AgentStatus&) {}
  template <typename Peers>
  bool wait_for_peers(const Peers& peers, std::chrono::milliseconds patience);
  void publish(const ImageResult& result);
  void publish_status();
  void write_status();
  [[nodiscard]] nlohmann::json status_json() const;
  void note(ExchangeEvent event, const std::string& peer, std::uint64_t keyframe_id);
  void write(ImageResult& result, double read_ms, double total_ms);
  [[nodiscard]] double cpu_s() const;
  [[nodiscard]] LostLines lost_lines() const;
  void picture(const ImageResult& result, const cv::Mat& pixels);
  void keep_calibration() const;
  [[nodiscard]] AgentSummary summary() const;

  AgentConfig config_;
  Dataset dataset_;
  Pipeline pipeline_;
  std::unique_ptr<Link> link_;      // none when flown alone
  OnboardLink* onboard_ = nullptr;  // of a live flight
  // Once all that it takes to fly is there: what a start that fails finds of an earlier flight
  // stays.
  std::filesystem::path folder_;
  StatusFile status_file_;
  OdometryWriter odometry_file_;
  TimingWriter timing_file_;
  LinkWriter link_file_;
  ExchangeWriter exchange_file_;
  FlightWarnings warnings_;
  // Of a calibrated thermal camera.
  std::optional<ThermalWriter> thermal_file_;
  std::optional<FlightPictures> pictures_;

  std::size_t next_imu_ = 0;
  std::vector<Inbound> taken_;
  PeerCounts peer_counts_;
  FlightCounts counts_;
  CpuLoadMonitor cpu_load_;
  std::optional<TimeNs> first_ns_;  // of the recording, or the first image of a live flight
  TimeNs last_ns_ = 0;
  std::optional<AgentStatus> told_status_;
  TimeNs told_motion_ns_ = 0;  // between images
};

// Flies at the configured pace: by itself, or as a team says over `control_fd`. Returns false if it
// was stopped before its end.
bool run_agent(const AgentConfig& config, std::optional<int> control_fd);

}  // namespace covey
