// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_figures.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <tuple>
#include <utility>

#include "apps/evaluation.h"
#include "apps/lab_flight.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using Figure = LabFigures::Figure;

constexpr double kSoon_ms = 500;
constexpr double kRejoined_s = 5;  // after a partition

Figure share(double part, double whole) {
  if (whole <= 0) return std::nullopt;
  return part / whole;
}

// The smallest value that at least this share does not exceed.
Figure quantile(std::vector<double> values, double share_below) {
  if (values.empty()) return std::nullopt;
  std::sort(values.begin(), values.end());
  const double rank = std::ceil(share_below * static_cast<double>(values.size()));
  return values[static_cast<std::size_t>(std::max(rank, 1.0)) - 1];
}

// ------------------------------------------------------------------------- questions and answers

// Who asked (or is told), who answered, and which keyframe it was about.
using AnswerKey = std::tuple<std::string, std::string, std::uint64_t>;

struct Answer {
  double sent_ms = 0;
  std::optional<double> handled_ms;
  bool fused = false;
};

std::optional<double> moment(const std::map<std::pair<std::string, std::uint64_t>, double>& moments,
                             const std::string& drone, std::uint64_t keyframe) {
  const auto found = moments.find({drone, keyframe});
  if (found == moments.end()) return std::nullopt;
  return found->second;
}

class ExchangeJudge {
 public:
  explicit ExchangeJudge(const ExchangeLogs& logs) : logs_(logs) {
    for (const auto& [drone, records] : logs) {
      for (const ExchangeRecord& record : records) {
        if (record.event == ExchangeEvent::kAsked) {
          asked_[{drone, record.keyframe_id}] = record.clock_ms;
        }
        if (record.event == ExchangeEvent::kHeard) ++heard_;
        if (record.event == ExchangeEvent::kAnswered) take_answer(drone, record);
      }
    }
    for (const auto& [drone, records] : logs) {
      for (const ExchangeRecord& record : records) take_outcome(drone, record);
    }
  }

  void judge(LabFigures& figures) const {
    const auto others = static_cast<double>(logs_.size()) - 1;
    figures.asked = static_cast<double>(asked_.size());
    figures.heard_share = share(heard_, static_cast<double>(asked_.size()) * others);
    int arrived = 0, fused = 0, arrived_soon = 0, fused_soon = 0, cut_off = 0;
    std::vector<double> round_trips_ms, deliveries_ms;
    for (const auto& [key, answer] : answers_) {
      const auto& [receiver, sender, keyframe] = key;
      const double asked_ms = moment(asked_, receiver, keyframe).value_or(answer.sent_ms);
      if (!answer.handled_ms) {
        cut_off += last_note_ms(receiver) < asked_ms + kSoon_ms ? 1 : 0;
        continue;
      }
      ++arrived;
      fused += answer.fused ? 1 : 0;
      deliveries_ms.push_back(*answer.handled_ms - answer.sent_ms);
      const double trip_ms = *answer.handled_ms - asked_ms;
      round_trips_ms.push_back(trip_ms);
      arrived_soon += trip_ms <= kSoon_ms ? 1 : 0;
      fused_soon += answer.fused && trip_ms <= kSoon_ms ? 1 : 0;
    }
    const auto sent = static_cast<double>(answers_.size());
    figures.answers = sent;
    figures.arrived_share = share(arrived, sent);
    figures.fused = fused;
    figures.fused_share = share(fused, sent);
    figures.arrived_500ms_share = share(arrived_soon, sent - cut_off);
    figures.fused_500ms_share = share(fused_soon, sent - cut_off);
    figures.round_trip_ms = quantile(round_trips_ms, 0.5);
    figures.round_trip_p95_ms = quantile(round_trips_ms, 0.95);
    figures.delivery_ms = quantile(deliveries_ms, 0.5);
    figures.delivery_p95_ms = quantile(deliveries_ms, 0.95);
  }

 private:
  // Its last sign of life.
  [[nodiscard]] double last_note_ms(const std::string& drone) const {
    const std::vector<ExchangeRecord>& records = logs_.at(drone);
    return records.empty() ? 0 : records.back().clock_ms;
  }

  void take_answer(const std::string& drone, const ExchangeRecord& record) {
    for (const auto& [receiver, records] : logs_) {
      if (receiver == drone || (record.peer != kEveryPeer && record.peer != receiver)) continue;
      answers_[{receiver, drone, record.keyframe_id}].sent_ms = record.clock_ms;
    }
  }

  void take_outcome(const std::string& drone, const ExchangeRecord& record) {
    const bool fused = record.event == ExchangeEvent::kFused;
    if (!fused && record.event != ExchangeEvent::kGated &&
        record.event != ExchangeEvent::kRejected) {
      return;
    }
    // Its sender may have been killed before its log was on the disk.
    const auto found = answers_.find({drone, record.peer, record.keyframe_id});
    if (found == answers_.end()) return;
    found->second.handled_ms = record.clock_ms;
    found->second.fused = fused;
  }

  const ExchangeLogs& logs_;
  std::map<std::pair<std::string, std::uint64_t>, double> asked_;
  std::map<AnswerKey, Answer> answers_;
  int heard_ = 0;
};

void append_log(const fs::path& folder, std::vector<ExchangeRecord>& records) {
  const fs::path file = folder / kExchangeFile;
  if (!fs::exists(file) || fs::file_size(file) == 0) return;
  for (ExchangeRecord& record : read_exchange(file)) records.push_back(std::move(record));
}

// --------------------------------------------------------------------------------------- network

double total(const std::vector<PortCounts>& ports, std::uint64_t PortCounts::*count) {
  double sum = 0;
  for (const PortCounts& port : ports) sum += static_cast<double>(port.*count);
  return sum;
}

void judge_network(const LabFlightResult& flight, LabFigures& figures) {
  const std::vector<PortCounts>& ports = flight.together;
  const auto drones = static_cast<double>(ports.size());
  figures.met_after_s = flight.met_after_s;
  if (flight.start_ms > 0) figures.longest_silence_s = flight.longest_silence_s;
  if (flight.met_after_s) {
    figures.meeting_bytes = total(flight.meeting, &PortCounts::bytes_sent) / drones;
  }
  if (flight.together_s > 0) {
    figures.wire_bytes_per_s = total(ports, &PortCounts::bytes_sent) / drones / flight.together_s;
  }
  const double delivered = total(ports, &PortCounts::delivered),
               lost = total(ports, &PortCounts::lost),
               queue_full = total(ports, &PortCounts::queue_full),
               cut = total(ports, &PortCounts::cut);
  const double all = delivered + lost + queue_full + cut;
  figures.lost_share = share(lost, all);
  figures.queue_full_share = share(queue_full, all);
  figures.cut_share = share(cut, all);
}

void judge_payload(const RunSummary& run, const LabFlightResult& flight, LabFigures& figures) {
  double once = 0, to_each = 0, frames = 0, dropped = 0;
  const auto drones = static_cast<double>(run.agents.size());
  for (const auto& [name, agent] : run.agents) {
    frames += static_cast<double>(agent.frames);
    dropped += static_cast<double>(agent.frames_dropped);
    if (!agent.link) continue;
    const auto questions = static_cast<double>(agent.link->request.payload_bytes_sent);
    const auto answers = static_cast<double>(agent.link->message.payload_bytes_sent);
    once += questions + answers;
    to_each += questions * (drones - 1) + answers;
  }
  figures.frames = frames;
  figures.frames_dropped = dropped;
  if (flight.together_s <= 0) return;
  figures.payload_bytes_per_s = once / drones / flight.together_s;
  figures.wire_over_payload =
      share(*figures.wire_bytes_per_s * drones * flight.together_s, to_each);
}

// -------------------------------------------------------------------------------------- accuracy

Figure mean_error(const RunSummary& run, AteSummary AccuracySummary::*alignment) {
  double sum = 0;
  for (const auto& [name, agent] : run.agents) {
    if (!agent.accuracy) return std::nullopt;
    sum += (*agent.accuracy.*alignment).rmse;
  }
  return sum / static_cast<double>(run.agents.size());
}

Figure ratio(const Figure& part, const Figure& whole) {
  if (!part || !whole) return std::nullopt;
  return share(*part, *whole);
}

void judge_accuracy(const RunSummary& together, const std::optional<RunSummary>& alone,
                    LabFigures& figures) {
  figures.ate_m = mean_error(together, &AccuracySummary::se3);
  figures.unaligned_m = mean_error(together, &AccuracySummary::none);
  if (!alone) return;
  figures.ate_alone_m = mean_error(*alone, &AccuracySummary::se3);
  figures.ate_ratio = ratio(figures.ate_m, figures.ate_alone_m);
  figures.unaligned_alone_m = mean_error(*alone, &AccuracySummary::none);
  figures.unaligned_ratio = ratio(figures.unaligned_m, figures.unaligned_alone_m);
}

// ------------------------------------------------------------------------------------- partition

// Of these drones, over stamps from `from_ns` up to `until_ns`, in the common world.
Figure error_between(const fs::path& run, const std::vector<std::string>& drones, TimeNs from_ns,
                     TimeNs until_ns) {
  double sum2 = 0, count = 0;
  for (const std::string& name : drones) {
    const fs::path estimate = run / name / kTrajectoryFile, truth = run / name / kGroundTruthFile;
    if (!fs::exists(estimate) || !fs::exists(truth)) return std::nullopt;
    std::vector<PosePair> pairs;
    try {
      pairs = associate(read_trajectory(estimate), read_trajectory(truth), {});
    } catch (const std::runtime_error&) {
      return std::nullopt;  // it has not flown long enough
    }
    for (const PosePair& pair : pairs) {
      if (pair.stamp_ns < from_ns || pair.stamp_ns > until_ns) continue;
      sum2 += (pair.estimate.p_world_imu - pair.truth.p_world_imu).squaredNorm();
      count += 1;
    }
  }
  if (count == 0) return std::nullopt;
  return std::sqrt(sum2 / count);
}

bool on_both_sides(const LabPartition& partition, const std::string& a, const std::string& b) {
  const auto apart = [&](const std::string& drone) {
    return std::find(partition.apart.begin(), partition.apart.end(), drone) !=
           partition.apart.end();
  };
  return apart(a) != apart(b);
}

Figure fused_again(const LabPartition& partition, const ExchangeLogs& logs, double end_ms) {
  Figure soonest_s;
  for (const auto& [drone, records] : logs) {
    for (const ExchangeRecord& record : records) {
      if (record.event != ExchangeEvent::kFused || record.clock_ms < end_ms) continue;
      if (!on_both_sides(partition, drone, record.peer)) continue;
      const double after_s = (record.clock_ms - end_ms) * 1e-3;
      soonest_s = std::min(soonest_s.value_or(after_s), after_s);
    }
  }
  return soonest_s;
}

void judge_partition(const LabEvidence& evidence, LabFigures& figures) {
  if (evidence.experiment.partitions.empty()) return;
  const LabPartition& partition = evidence.experiment.partitions.front();
  const LabFlightResult& flight = evidence.flight;
  const TimeNs from_ns = flight.first_ns + nanoseconds(partition.from_s);
  const TimeNs until_ns = flight.first_ns + nanoseconds(partition.until_s);
  const TimeNs rejoined_ns = until_ns + nanoseconds(kRejoined_s);
  const TimeNs end_ns = until_ns + nanoseconds(flight.flight.recorded_s);
  const std::vector<std::string>& cut = partition.apart;
  figures.apart_m = error_between(evidence.run, cut, from_ns, until_ns);
  figures.apart_alone_m = error_between(evidence.alone_run, cut, from_ns, until_ns);
  figures.rejoined_m = error_between(evidence.run, cut, rejoined_ns, end_ns);
  figures.rejoined_alone_m = error_between(evidence.alone_run, cut, rejoined_ns, end_ns);
  const double end_ms = flight.start_ms + 1e3 * partition.until_s / evidence.experiment.pace;
  figures.fused_again_s = fused_again(partition, evidence.exchange, end_ms);
}

void judge_kills(const LabFlightResult& flight, LabFigures& figures) {
  std::vector<double> again_s;
  for (const LabKill& kill : flight.kills) {
    if (kill.met_again_s) again_s.push_back(*kill.met_again_s);
  }
  figures.kills = static_cast<double>(flight.kills.size());
  figures.met_again = static_cast<double>(again_s.size());
  figures.met_again_median_s = quantile(again_s, 0.5);
  figures.met_again_max_s = quantile(again_s, 1);
}

}  // namespace

Figure memory_growth(const std::vector<LabMemory>& memory) {
  constexpr double kShortest_s = 120;
  double end_s = 0;
  for (const LabMemory& sample : memory) end_s = std::max(end_s, sample.at_s);
  if (end_s < kShortest_s) return std::nullopt;
  std::map<std::string, std::vector<double>> early, late;
  for (const LabMemory& sample : memory) {
    if (sample.at_s >= 0.9 * end_s) late[sample.drone].push_back(sample.mib);
    if (sample.at_s >= 0.2 * end_s && sample.at_s < 0.3 * end_s)
      early[sample.drone].push_back(sample.mib);
  }
  Figure most;
  for (const auto& [drone, samples] : early) {
    const Figure growth = ratio(quantile(late[drone], 0.5), quantile(samples, 0.5));
    if (growth) most = std::max(most.value_or(*growth - 1), *growth - 1);
  }
  return most;
}

const std::vector<LabFigureColumn>& lab_figure_columns() {
  static const std::vector<LabFigureColumn> columns{
      {"met_after_s", &LabFigures::met_after_s},
      {"meeting_bytes", &LabFigures::meeting_bytes},
      {"frames", &LabFigures::frames},
      {"frames_dropped", &LabFigures::frames_dropped},
      {"asked", &LabFigures::asked},
      {"heard_share", &LabFigures::heard_share},
      {"answers", &LabFigures::answers},
      {"arrived_share", &LabFigures::arrived_share},
      {"fused", &LabFigures::fused},
      {"fused_share", &LabFigures::fused_share},
      {"arrived_500ms_share", &LabFigures::arrived_500ms_share},
      {"fused_500ms_share", &LabFigures::fused_500ms_share},
      {"round_trip_ms", &LabFigures::round_trip_ms},
      {"round_trip_p95_ms", &LabFigures::round_trip_p95_ms},
      {"delivery_ms", &LabFigures::delivery_ms},
      {"delivery_p95_ms", &LabFigures::delivery_p95_ms},
      {"payload_bytes_per_s", &LabFigures::payload_bytes_per_s},
      {"wire_bytes_per_s", &LabFigures::wire_bytes_per_s},
      {"wire_over_payload", &LabFigures::wire_over_payload},
      {"lost_share", &LabFigures::lost_share},
      {"queue_full_share", &LabFigures::queue_full_share},
      {"cut_share", &LabFigures::cut_share},
      {"ate_m", &LabFigures::ate_m},
      {"ate_alone_m", &LabFigures::ate_alone_m},
      {"ate_ratio", &LabFigures::ate_ratio},
      {"unaligned_m", &LabFigures::unaligned_m},
      {"unaligned_alone_m", &LabFigures::unaligned_alone_m},
      {"unaligned_ratio", &LabFigures::unaligned_ratio},
      {"apart_m", &LabFigures::apart_m},
      {"apart_alone_m", &LabFigures::apart_alone_m},
      {"rejoined_m", &LabFigures::rejoined_m},
      {"rejoined_alone_m", &LabFigures::rejoined_alone_m},
      {"fused_again_s", &LabFigures::fused_again_s},
      {"kills", &LabFigures::kills},
      {"met_again", &LabFigures::met_again},
      {"met_again_median_s", &LabFigures::met_again_median_s},
      {"met_again_max_s", &LabFigures::met_again_max_s},
      {"longest_silence_s", &LabFigures::longest_silence_s},
      {"memory_growth", &LabFigures::memory_growth},
      {"ended_early", &LabFigures::ended_early},
      {"shared_memory_left", &LabFigures::shared_memory_left},
  };
  return columns;
}

nlohmann::json to_json(const LabFigures& figures) {
  nlohmann::json json = nlohmann::json::object();
  for (const LabFigureColumn& column : lab_figure_columns()) {
    const Figure& figure = figures.*column.figure;
    json[column.name] = figure ? nlohmann::json(*figure) : nlohmann::json();
  }
  return json;
}

LabFigures lab_figures_from_json(const nlohmann::json& json) {
  LabFigures figures;
  for (const LabFigureColumn& column : lab_figure_columns()) {
    const nlohmann::json& value = json.at(column.name);
    if (!value.is_null()) figures.*column.figure = value.get<double>();
  }
  return figures;
}

ExchangeLogs read_exchange_logs(const fs::path& run) {
  ExchangeLogs logs;
  for (const auto& drone : fs::directory_iterator(run)) {
    if (!fs::exists(drone.path() / kExchangeFile)) continue;
    std::vector<ExchangeRecord>& records = logs[drone.path().filename().string()];
    append_log(drone.path(), records);
    for (const auto& life : fs::directory_iterator(drone.path())) {
      if (life.is_directory()) append_log(life.path(), records);
    }
  }
  return logs;
}

void judge_exchange(const ExchangeLogs& logs, LabFigures& figures) {
  ExchangeJudge(logs).judge(figures);
}

LabFigures judge(const LabEvidence& evidence) {
  LabFigures figures;
  judge_network(evidence.flight, figures);
  figures.ended_early = static_cast<double>(evidence.flight.flight.ended_early.size());
  if (!evidence.together) return figures;
  if (!evidence.flight.kills.empty()) {
    // Logs of those who were killed end early, and their keyframes count from one again: nothing
    // else could be told from them.
    judge_kills(evidence.flight, figures);
    return figures;
  }
  figures.memory_growth = memory_growth(evidence.flight.memory);
  judge_payload(*evidence.together, evidence.flight, figures);
  judge_exchange(evidence.exchange, figures);
  judge_accuracy(*evidence.together, evidence.alone, figures);
  judge_partition(evidence, figures);
  return figures;
}

}  // namespace covey
