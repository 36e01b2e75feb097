// SPDX-License-Identifier: Apache-2.0
#include "apps/run_summary.h"

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "apps/json_file.h"
#include "estimator/so3.h"

namespace covey {
namespace {

using Json = nlohmann::json;

constexpr int kSchema = 1;

template <typename T>
Json or_null(const std::optional<T>& value) {
  return value ? Json(*value) : Json(nullptr);
}

Json to_json(const AteSummary& ate) {
  Json json = {{"rmse", ate.rmse}, {"mean", ate.mean}, {"std", ate.std}};
  if (ate.scale) json["scale"] = *ate.scale;
  return json;
}

Json ate_to_json(const AccuracySummary& accuracy) {
  return {{"none", to_json(accuracy.none)},
          {"posyaw", to_json(accuracy.posyaw)},
          {"se3", to_json(accuracy.se3)},
          {"sim3", to_json(accuracy.sim3)}};
}

Json rotation_to_json(const AccuracySummary& accuracy) {
  return {{"none", accuracy.rotation_none_deg},
          {"posyaw", accuracy.rotation_posyaw_deg},
          {"se3", accuracy.rotation_se3_deg}};
}

Json nees_to_json(const AccuracySummary& accuracy) {
  if (!accuracy.nees_position || !accuracy.nees_orientation) return nullptr;
  return {{"position", *accuracy.nees_position}, {"orientation", *accuracy.nees_orientation}};
}

// One list for writing, reading and averaging.
struct Stage {
  const char* key;
  std::optional<double> StageSummary::*mean;
  double TimingRecord::*ms;
};
constexpr Stage kStages[] = {
    {"thermal", &StageSummary::thermal, &TimingRecord::thermal_ms},
    {"track", &StageSummary::track, &TimingRecord::track_ms},
    {"describe", &StageSummary::describe, &TimingRecord::describe_ms},
    {"place", &StageSummary::place, &TimingRecord::place_ms},
    {"match", &StageSummary::match, &TimingRecord::match_ms},
    {"propagate", &StageSummary::propagate, &TimingRecord::propagate_ms},
    {"msckf", &StageSummary::msckf, &TimingRecord::msckf_ms},
    {"slam", &StageSummary::slam, &TimingRecord::slam_ms},
    {"peer", &StageSummary::peer, &TimingRecord::peer_ms},
};

Json to_json(const StageSummary& stages) {
  Json json = Json::object();
  for (const Stage& stage : kStages) json[stage.key] = or_null(stages.*stage.mean);
  return json;
}

Json to_json(const LinkSummary& link) {
  Json json = {{"request",
                {{"sent", link.request.sent},
                 {"received", link.request.received},
                 {"payload_bytes_sent", link.request.payload_bytes_sent}}},
               {"message",
                {{"sent", link.message.sent},
                 {"received", link.message.received},
                 {"payload_bytes_sent", link.message.payload_bytes_sent},
                 {"fused", link.message.fused},
                 {"gated", link.message.gated},
                 {"rejected", link.message.rejected}}},
               {"wire_bytes_sent", or_null(link.wire_bytes_sent)},
               {"wire_bytes_received", or_null(link.wire_bytes_received)}};
  if (!link.clocks.empty()) json["clocks"] = covey::to_json(link.clocks);
  if (!link.restarts.empty()) json["restarts"] = link.restarts;
  return json;
}

// A json object together with the way to it: "RUN/summary.json: agents.uav0.link".
class Object {
 public:
  Object(const Json& json, std::string where) : json_(json), where_(std::move(where)) {
    if (!json_.is_object()) fail("is not an object");
  }

  [[nodiscard]] const Json& at(const std::string& key) const {
    const auto found = json_.find(key);
    if (found == json_.end()) fail("the key '" + key + "' is missing");
    return *found;
  }

  [[nodiscard]] std::vector<std::string> keys() const {
    std::vector<std::string> keys;
    for (const auto& item : json_.items()) keys.push_back(item.key());
    return keys;
  }

  [[nodiscard]] bool has(const std::string& key) const { return json_.contains(key); }
  [[nodiscard]] bool is_null(const std::string& key) const { return at(key).is_null(); }

  [[nodiscard]] Object child(const std::string& key) const {
    return {at(key), where_ + (where_.back() == ':' ? " " : ".") + key};
  }

  template <typename T>
  [[nodiscard]] T get(const std::string& key) const {
    try {
      return at(key).template get<T>();
    } catch (const Json::exception&) {
      fail("the value of '" + key + "' is of the wrong type");
    }
  }

  template <typename T>
  [[nodiscard]] std::optional<T> optional(const std::string& key) const {
    if (is_null(key)) return std::nullopt;
    return get<T>(key);
  }

  [[noreturn]] void fail(const std::string& what) const {
    throw std::runtime_error(where_ + " " + what);
  }

 private:
  const Json& json_;
  std::string where_;
};

std::map<std::string, AlignmentSummary> alignments_from(const Object& peers) {
  std::map<std::string, AlignmentSummary> alignments;
  for (const std::string& peer : peers.keys()) {
    const Object json = peers.child(peer);
    alignments[peer] = {json.get<double>("position_error_m"), json.get<double>("yaw_error_deg"),
                        json.get<double>("position_sigma_m"), json.get<double>("yaw_sigma_deg")};
  }
  return alignments;
}

std::map<std::string, ClockSummary> clocks_from(const Object& peers) {
  std::map<std::string, ClockSummary> clocks;
  for (const std::string& peer : peers.keys()) {
    const Object json = peers.child(peer);
    clocks[peer] = {json.get<double>("clock_offset_ms"), json.get<double>("round_trip_ms")};
  }
  return clocks;
}

AteSummary ate_from(const Object& json, bool with_scale) {
  AteSummary ate;
  ate.rmse = json.get<double>("rmse");
  ate.mean = json.get<double>("mean");
  ate.std = json.get<double>("std");
  if (with_scale) ate.scale = json.get<double>("scale");
  return ate;
}

std::optional<AccuracySummary> accuracy_from(const Object& agent) {
  if (agent.is_null("ate_m")) return std::nullopt;
  AccuracySummary accuracy;
  const Object ate = agent.child("ate_m");
  accuracy.none = ate_from(ate.child("none"), false);
  accuracy.posyaw = ate_from(ate.child("posyaw"), false);
  accuracy.se3 = ate_from(ate.child("se3"), false);
  accuracy.sim3 = ate_from(ate.child("sim3"), true);
  const Object rotation = agent.child("rotation_rmse_deg");
  accuracy.rotation_none_deg = rotation.get<double>("none");
  accuracy.rotation_posyaw_deg = rotation.get<double>("posyaw");
  accuracy.rotation_se3_deg = rotation.get<double>("se3");
  if (!agent.is_null("nees")) {
    const Object nees = agent.child("nees");
    accuracy.nees_position = nees.get<double>("position");
    accuracy.nees_orientation = nees.get<double>("orientation");
  }
  return accuracy;
}

std::optional<LinkSummary> link_from(const Object& agent) {
  if (agent.is_null("link")) return std::nullopt;
  const Object link = agent.child("link");
  const Object request = link.child("request");
  const Object message = link.child("message");
  LinkSummary summary;
  summary.request = {request.get<std::int64_t>("sent"), request.get<std::int64_t>("received"),
                     request.get<std::int64_t>("payload_bytes_sent")};
  summary.message = {message.get<std::int64_t>("sent"),
                     message.get<std::int64_t>("received"),
                     message.get<std::int64_t>("payload_bytes_sent"),
                     message.get<std::int64_t>("fused"),
                     message.get<std::int64_t>("gated"),
                     message.get<std::int64_t>("rejected")};
  summary.wire_bytes_sent = link.optional<std::int64_t>("wire_bytes_sent");
  summary.wire_bytes_received = link.optional<std::int64_t>("wire_bytes_received");
  if (link.has("clocks")) summary.clocks = clocks_from(link.child("clocks"));
  if (link.has("restarts"))
    summary.restarts = link.get<std::map<std::string, std::int64_t>>("restarts");
  return summary;
}

AgentSummary agent_from(const Object& json) {
  AgentSummary agent;
  agent.frames = json.get<std::int64_t>("frames");
  agent.frames_dropped = json.get<std::int64_t>("frames_dropped");
  agent.initialised_after_s = json.optional<double>("initialised_after_s");
  agent.distance_m = json.optional<double>("distance_m");
  agent.accuracy = accuracy_from(json);
  agent.cpu_ms_per_frame = json.optional<double>("cpu_ms_per_frame");
  agent.max_rss_mib = json.optional<double>("max_rss_mib");
  agent.max_cpu_percent = json.optional<double>("max_cpu_percent");
  const Object stages = json.child("stage_ms");
  for (const Stage& stage : kStages) {
    agent.stage_ms.*stage.mean = stages.optional<double>(stage.key);
  }
  const Object tracks = json.child("tracks");
  agent.mean_tracks_per_frame = tracks.optional<double>("mean_per_frame");
  agent.mean_track_length = tracks.optional<double>("mean_length");
  agent.link = link_from(json);
  if (json.has("alignments")) agent.alignments = alignments_from(json.child("alignments"));
  if (json.has("not_started")) agent.not_started = json.get<std::string>("not_started");
  if (json.has("incomplete")) agent.incomplete = json.get<std::string>("incomplete");
  if (json.has("lost_lines")) agent.lost_lines = json.get<LostLines>("lost_lines");
  return agent;
}

Eigen::VectorXd numbers_from(const Object& json, const std::string& key, Eigen::Index size) {
  if (size == 1) return Eigen::VectorXd::Constant(1, json.get<double>(key));
  const auto numbers = json.get<std::vector<double>>(key);
  const auto found = static_cast<Eigen::Index>(numbers.size());
  if (found != size) {
    json.fail("the value of '" + key + "' has " + std::to_string(found) + " numbers, not " +
              std::to_string(size));
  }
  return Eigen::Map<const Eigen::VectorXd>(numbers.data(), size);
}

Eigen::Quaterniond rotation_from(const Object& json, const std::string& key) {
  const Eigen::Quaterniond q(Eigen::Vector4d(numbers_from(json, key, 4)));
  if (std::abs(q.norm() - 1) > 1e-6) json.fail("the value of '" + key + "' is no unit quaternion");
  return q;
}

CalibrationChange part(const CalibrationChange& whole, int first, int size) {
  return {whole.difference.segment(first, size), whole.sigma.segment(first, size),
          whole.sigma_at_start.segment(first, size)};
}

CameraChanges camera_changes_from(const Object& found) {
  const Object at_start = found.child("at_start");
  const auto difference = [&](const char* key, int size) -> Eigen::VectorXd {
    return numbers_from(found, key, size) - numbers_from(at_start, key, size);
  };
  const auto change = [&](const Eigen::VectorXd& by, const char* sigma) -> CalibrationChange {
    return {by, numbers_from(found, sigma, by.size()), numbers_from(at_start, sigma, by.size())};
  };
  const Eigen::Quaterniond turn = rotation_from(at_start, "q_imu_cam_xyzw").conjugate() *
                                  rotation_from(found, "q_imu_cam_xyzw");
  const CalibrationChange intrinsics =
      change(difference("intrinsics_px", 4), "intrinsics_sigma_px");
  const CalibrationChange k1_k2 = change(difference("distortion", 4).head<2>(), "k1_k2_sigma");
  CameraChanges changes;
  changes.time_offset_s = change(difference("time_offset_s", 1), "time_offset_sigma_s");
  changes.rotation_deg = change(180 / M_PI * log_quaternion(turn), "q_imu_cam_sigma_deg");
  changes.p_imu_cam_m = change(difference("p_imu_cam_m", 3), "p_imu_cam_sigma_m");
  changes.focal_lengths_px = part(intrinsics, 0, 2);
  changes.principal_point_px = part(intrinsics, 2, 2);
  changes.k1 = part(k1_k2, 0, 1);
  changes.k2 = part(k1_k2, 1, 1);
  return changes;
}

AteSummary summarize(const AbsoluteError& error) {
  return {error.position_m.rmse, error.position_m.mean, error.position_m.std, std::nullopt};
}

}  // namespace

nlohmann::json to_json(const std::map<std::string, ClockSummary>& clocks) {
  Json json = Json::object();
  for (const auto& [peer, clock] : clocks) {
    json[peer] = {{"clock_offset_ms", clock.clock_offset_ms},
                  {"round_trip_ms", clock.round_trip_ms}};
  }
  return json;
}

std::int64_t restart_count(const LinkSummary& link) {
  std::int64_t count = 0;
  for (const auto& [reason, restarts] : link.restarts) count += restarts;
  return count;
}

nlohmann::json to_json(const AgentSummary& agent) {
  const std::optional<AccuracySummary>& accuracy = agent.accuracy;
  Json json = {{"frames", agent.frames},
               {"frames_dropped", agent.frames_dropped},
               {"initialised_after_s", or_null(agent.initialised_after_s)},
               {"distance_m", or_null(agent.distance_m)},
               {"ate_m", accuracy ? ate_to_json(*accuracy) : Json(nullptr)},
               {"rotation_rmse_deg", accuracy ? rotation_to_json(*accuracy) : Json(nullptr)},
               {"nees", accuracy ? nees_to_json(*accuracy) : Json(nullptr)},
               {"cpu_ms_per_frame", or_null(agent.cpu_ms_per_frame)},
               {"max_rss_mib", or_null(agent.max_rss_mib)},
               {"max_cpu_percent", or_null(agent.max_cpu_percent)},
               {"stage_ms", to_json(agent.stage_ms)},
               {"tracks",
                {{"mean_per_frame", or_null(agent.mean_tracks_per_frame)},
                 {"mean_length", or_null(agent.mean_track_length)}}},
               {"link", agent.link ? to_json(*agent.link) : Json(nullptr)}};
  if (agent.alignments) {
    json["alignments"] = nlohmann::json::object();
    for (const auto& [peer, alignment] : *agent.alignments) {
      json["alignments"][peer] = {{"position_error_m", alignment.position_error_m},
                                  {"yaw_error_deg", alignment.yaw_error_deg},
                                  {"position_sigma_m", alignment.position_sigma_m},
                                  {"yaw_sigma_deg", alignment.yaw_sigma_deg}};
    }
  }
  if (agent.not_started) json["not_started"] = *agent.not_started;
  if (agent.incomplete) json["incomplete"] = *agent.incomplete;
  if (!agent.lost_lines.empty()) json["lost_lines"] = agent.lost_lines;
  return json;
}

nlohmann::json to_json(const RunSummary& run) {
  Json agents = Json::object();
  for (const auto& [name, agent] : run.agents) agents[name] = to_json(agent);
  return {{"schema", kSchema},          {"dataset", run.dataset},
          {"mode", run.mode},           {"exchange", or_null(run.exchange)},
          {"init", run.init},           {"real_time_factor", or_null(run.real_time_factor)},
          {"agents", std::move(agents)}};
}

AgentSummary agent_summary_from_json(const nlohmann::json& json, const std::string& where) {
  return agent_from(Object(json, where + ":"));
}

RunSummary run_summary_from_json(const nlohmann::json& json, const std::string& where) {
  const Object object(json, where + ":");
  if (const int schema = object.get<int>("schema"); schema != kSchema) {
    object.fail("has schema " + std::to_string(schema) + ", this program reads schema " +
                std::to_string(kSchema));
  }
  RunSummary run;
  run.dataset = object.get<std::string>("dataset");
  run.mode = object.get<std::string>("mode");
  run.exchange = object.optional<std::string>("exchange");
  run.init = object.get<std::string>("init");
  run.real_time_factor = object.optional<double>("real_time_factor");
  const Object agents = object.child("agents");
  for (const auto& [name, agent] : object.at("agents").items()) {
    run.agents[name] = agent_from(agents.child(name));
  }
  return run;
}

void write_run_summary(const std::filesystem::path& file, const RunSummary& run) {
  write_json_file(file, to_json(run));
}

RunSummary read_run_summary(const std::filesystem::path& file) {
  return run_summary_from_json(read_json_file(file), file.string());
}

std::optional<CameraChanges> read_camera_changes(const std::filesystem::path& agent_summary) {
  const nlohmann::json json = read_json_file(agent_summary);
  const Object summary(json, agent_summary.string() + ":");
  if (!summary.has("camera")) return std::nullopt;
  const Object camera = summary.child("camera");
  if (!camera.has("at_start")) return std::nullopt;
  return camera_changes_from(camera);
}

AccuracySummary summarize_accuracy(const StampedPoses& estimate, const StampedPoses& truth,
                                   const std::vector<StampedCovariance>& covariances) {
  const std::vector<PosePair> pairs = associate(estimate, truth, AssociationOptions());
  const AbsoluteError none = absolute_error(pairs, Alignment::kNone);
  const AbsoluteError posyaw = absolute_error(pairs, Alignment::kPosYaw);
  const AbsoluteError se3 = absolute_error(pairs, Alignment::kSe3);
  const AbsoluteError sim3 = absolute_error(pairs, Alignment::kSim3);
  AccuracySummary accuracy;
  accuracy.none = summarize(none);
  accuracy.posyaw = summarize(posyaw);
  accuracy.se3 = summarize(se3);
  accuracy.sim3 = summarize(sim3);
  accuracy.sim3.scale = sim3.scale;
  accuracy.rotation_none_deg = none.rotation_deg.rmse;
  accuracy.rotation_posyaw_deg = posyaw.rotation_deg.rmse;
  accuracy.rotation_se3_deg = se3.rotation_deg.rmse;
  if (const std::optional<Nees> result = nees(pairs, covariances)) {
    accuracy.nees_position = result->position;
    accuracy.nees_orientation = result->orientation;
  }
  return accuracy;
}

StageSummary summarize_stages(const std::vector<TimingRecord>& timings) {
  StageSummary summary;
  for (const Stage& stage : kStages) {
    double sum_ms = 0;
    for (const TimingRecord& record : timings) sum_ms += record.*stage.ms;
    if (sum_ms > 0) summary.*stage.mean = sum_ms / static_cast<double>(timings.size());
  }
  return summary;
}

}  // namespace covey
