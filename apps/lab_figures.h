// SPDX-License-Identifier: Apache-2.0
//
// What one flight in the laboratory has shown, from what its agents and its network left.
#pragma once

#include <filesystem>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "apps/lab_experiment.h"
#include "apps/run_files.h"
#include "apps/run_summary.h"

namespace covey {

struct LabFlightResult;
struct LabMemory;

// Empty: does not apply. Times are of the clock.
struct LabFigures {
  using Figure = std::optional<double>;

  Figure met_after_s;             // all drones, since the last one's link was open
  Figure meeting_bytes;           // sent per drone until then, whole Ethernet frames as all below
  Figure frames, frames_dropped;  // images of all drones
  // Questions: each drone hears those of all others.
  Figure asked, heard_share;
  // Answers, of those that were sent.
  Figure answers, arrived_share, fused, fused_share;
  // Within 500 ms of the question; what was under way when the receiver's flight ended is left out.
  Figure arrived_500ms_share, fused_500ms_share;
  Figure round_trip_ms, round_trip_p95_ms;       // question asked to answer handled
  Figure delivery_ms, delivery_p95_ms;           // answer sent to answer handled
  Figure payload_bytes_per_s, wire_bytes_per_s;  // per drone
  Figure wire_over_payload;  // a question counts once for each drone that it is sent to
  Figure lost_share, queue_full_share, cut_share;  // of frames, by the network
  // Mean of the drones' RMSE, aligned (SE3) and as they stand in the common world.
  Figure ate_m, ate_alone_m, ate_ratio;
  Figure unaligned_m, unaligned_alone_m, unaligned_ratio;
  // The first partition. RMSE of those apart, not aligned, from its beginning to its end and from 5
  // s after its end on; how long after it somebody fused what came from the other side.
  Figure apart_m, apart_alone_m, rejoined_m, rejoined_alone_m, fused_again_s;
  Figure kills, met_again, met_again_median_s, met_again_max_s, longest_silence_s;
  // Of the drone that grew the most: memory in the last tenth of the flight over that in the tenth
  // after a first fifth, less 1, medians. Flights of at least two minutes without kills.
  Figure memory_growth;
  Figure ended_early;         // drones, that nobody had killed
  Figure shared_memory_left;  // segments in /dev/shm that were not there before
};

struct LabFigureColumn {
  const char* name;
  LabFigures::Figure LabFigures::*figure;
};
[[nodiscard]] const std::vector<LabFigureColumn>& lab_figure_columns();

[[nodiscard]] nlohmann::json to_json(const LabFigures& figures);
[[nodiscard]] LabFigures lab_figures_from_json(const nlohmann::json& json);

// By drone, all its lives together.
using ExchangeLogs = std::map<std::string, std::vector<ExchangeRecord>>;
[[nodiscard]] ExchangeLogs read_exchange_logs(const std::filesystem::path& run);

// The part that questions and answers tell.
void judge_exchange(const ExchangeLogs& logs, LabFigures& figures);

// LabFigures::memory_growth; nothing for a flight that is too short.
[[nodiscard]] LabFigures::Figure memory_growth(const std::vector<LabMemory>& memory);

struct LabEvidence {
  const LabExperiment& experiment;
  const LabFlightResult& flight;
  std::filesystem::path run;
  ExchangeLogs exchange;
  // Empty when nobody flew.
  std::optional<RunSummary> together, alone;
  std::filesystem::path alone_run;
};
[[nodiscard]] LabFigures judge(const LabEvidence& evidence);

}  // namespace covey
