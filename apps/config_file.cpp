// SPDX-License-Identifier: Apache-2.0
#include "apps/config_file.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "apps/config_json.h"
#include "apps/json_file.h"

namespace covey {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kRadiansPerDegree = M_PI / 180;

class ConfigDescriber : public ConfigVisitor {
 public:
  void begin_section(const std::string& name) override { prefix_ = name + "."; }
  void end_section() override { text_ += "\n"; }
  void number(const char* key, double& value, Range range, const char* meaning) override {
    line(key, Json(value).dump(), range_text(range), meaning);
  }
  void integer(const char* key, std::int64_t& value, Range range, const char* meaning) override {
    line(key, std::to_string(value), range_text(range), meaning);
  }
  void flag(const char* key, bool& value, const char* meaning) override {
    line(key, value ? "true" : "false", "true | false", meaning);
  }
  void text(const char* key, std::string& value, const char* meaning) override {
    line(key, Json(value).dump(), "text", meaning);
  }
  void texts(const char* key, std::vector<std::string>& value, const char* meaning) override {
    line(key, Json(value).dump(), "list of texts", meaning);
  }
  void choice(const char* key, std::string& value, const std::vector<std::string>& names,
              const char* meaning) override {
    line(key, Json(value).dump(), join(names, " | "), meaning);
  }

  void values(const char* key, std::map<std::string, std::string>& value,
              const char* meaning) override {
    line(key, value.empty() ? "{}" : "{...}", "values by key", meaning);
  }

  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  void line(const char* key, const std::string& value, const std::string& range,
            const char* meaning) {
    constexpr std::size_t kKeyWidth = 44, kValueWidth = 22, kRangeWidth = 28;
    const auto padded = [](std::string word, std::size_t width) {
      word.resize(std::max(width, word.size() + 1), ' ');
      return word;
    };
    text_ += padded(prefix_ + key, kKeyWidth) + padded(value, kValueWidth) +
             padded(range, kRangeWidth) + meaning + "\n";
  }

  std::string prefix_, text_;
};

}  // namespace

void ConfigVisitor::angle(const char* key_deg, double& radians, Range degrees,
                          const char* meaning) {
  const double before = radians / kRadiansPerDegree;
  double value = before;
  number(key_deg, value, degrees, meaning);
  if (value != before) radians = value * kRadiansPerDegree;
}

void merge_config(const nlohmann::json& json, const std::string& file, AgentConfig& config) {
  AgentConfig merged = config;
  set_from_json(json, file, [&](ConfigVisitor& visitor) { visit_config(merged, visitor); });
  merged.link.profile = read_profile(merged.link_profile, file + ": link");
  config = merged;
}

EstimatorConfig estimator_in_flight() {
  EstimatorConfig config;
  config.calibrate_extrinsics = config.calibrate_time_offset = config.calibrate_intrinsics = true;
  // Of a careful calibration: what a short flight shows of the extrinsics is worth little more.
  config.extrinsics_sigma_m = 0.001;
  config.extrinsics_sigma_rad = 0.05 * M_PI / 180;
  config.imu_noise_scale = 2;
  return config;
}

DriftConfig drift_config(const FusionConfig& fusion, bool has_truth) {
  DriftConfig drift = fusion.drift;
  const bool exact =
      fusion.starts == KnownStarts::kExact || (fusion.starts == KnownStarts::kAuto && has_truth);
  drift.start_position_sigma_m = exact ? 0 : fusion.start_position_sigma_m;
  drift.start_yaw_sigma = exact ? 0 : fusion.start_yaw_sigma;
  return drift;
}

std::optional<ThermalMode> thermal_mode_from_name(const std::string& name) {
  if (name == "auto") return ThermalMode::kAuto;
  if (name == "raw") return ThermalMode::kRaw;
  if (name == "calibrated") return ThermalMode::kCalibrated;
  return std::nullopt;
}

bool is_thermal_camera(ThermalMode mode, bool named) {
  return named || mode == ThermalMode::kCalibrated;
}

bool is_calibrated(ThermalMode mode, bool named) {
  return mode != ThermalMode::kRaw && is_thermal_camera(mode, named);
}

AgentConfig read_config(const std::filesystem::path& file) {
  AgentConfig config;
  merge_config(read_json_file(file), file.string(), config);
  return config;
}

LinkConfig link_config(const AgentConfig& config) {
  LinkConfig link = config.link;
  link.agent = config.agent.name;
  link.full_messages = config.collaboration.exchange != ExchangeMode::kCompact;
  return link;
}

OnboardConfig onboard_config(const AgentConfig& config) {
  OnboardConfig onboard = config.onboard;
  onboard.image_queue = static_cast<std::size_t>(config.agent.image_queue);
  return onboard;
}

// Drones that start in worlds of their own may be anywhere in each other's.
CollaboratorConfig collaborator_config(const AgentConfig& config, bool has_truth) {
  CollaboratorConfig collaboration = config.collaboration;
  collaboration.agent = config.agent.name;
  const DriftConfig drift = drift_config(config.fusion, has_truth);
  KeyframeMatcherConfig& matching = collaboration.matching;
  matching.common_start = drift.common_start;
  matching.start_position_sigma = drift.start_position_sigma_m;
  matching.start_yaw_sigma = drift.start_yaw_sigma;
  if (!drift.common_start) {
    matching.verification.max_offset = 1e6;
    matching.verification.max_yaw = M_PI;
  }
  return collaboration;
}

namespace {

// Of the least and the most of something.
void require_order(const AgentConfig& config) {
  const OutlierConfig& outliers = config.tracker.outliers;
  if (config.estimator.min_depth >= config.estimator.max_depth)
    throw std::runtime_error("estimator.min_depth_m is not below estimator.max_depth_m");
  if (outliers.min_epipolar_px > outliers.max_epipolar_px) {
    throw std::runtime_error(
        "tracker.outlier_min_epipolar_px is above tracker.outlier_max_epipolar_px");
  }
}

}  // namespace

void require_possible(const AgentConfig& config) {
  require_order(config);
  if (config.agent.pace == Pace::kLive && config.initialisation.method != InitMethod::kStatic) {
    throw std::runtime_error(
        "agent.pace is live, and no ground truth says where a live flight starts: set "
        "initialisation.method to static");
  }
  if (config.agent.mode == FlightMode::kSolo) return;
  const bool shares_interfaces = !config.onboard.loopback_only && !config.link.loopback_only;
  if (config.agent.pace == Pace::kLive && shares_interfaces &&
      config.onboard.domain == config.link.domain) {
    throw std::runtime_error(
        "onboard.domain and link.domain are both " + std::to_string(config.link.domain) +
        ", and both use the interfaces of the network: other drones would look for this one where "
        "its camera is heard; give one of them another number");
  }
  if (config.agent.wait_for_peers >= config.link.max_agents) {
    throw std::runtime_error("agent.wait_for_peers is " +
                             std::to_string(config.agent.wait_for_peers) +
                             ", and link.max_agents of " + std::to_string(config.link.max_agents) +
                             " counts this drone too: raise it");
  }
  if (config.initialisation.own_world && config.fusion.drift.common_start) {
    throw std::runtime_error(
        "initialisation.own_world is true, and fusion.common_start too: drones that start each in "
        "a world of its own share none; set fusion.common_start to false");
  }
  if (!config.fusion.drift.common_start && config.fusion.mode != FusionMode::kJoint) {
    throw std::runtime_error(
        "fusion.common_start is false, which needs fusion.mode joint: the other fuses drones that "
        "share one world");
  }
}

namespace {

// As JSON is; names of folders need not be.
void require_utf8(const std::string& key, const std::string& value) {
  try {
    (void)Json(value).dump();
  } catch (const Json::exception&) {
    throw std::runtime_error(key +
                             " is not UTF-8, in which settings are written: " + printable(value));
  }
}

}  // namespace

std::string print_config(const AgentConfig& config) {
  require_utf8("agent.name", config.agent.name);
  require_utf8("agent.dataset", config.agent.dataset);
  require_utf8("agent.out", config.agent.out);
  AgentConfig copy = config;
  const auto json = to_ordered_json([&](ConfigVisitor& visitor) { visit_config(copy, visitor); });
  return json.dump(2) + "\n";
}

std::string describe_config() {
  AgentConfig config;
  ConfigDescriber describer;
  visit_config(config, describer);
  return describer.text();
}

}  // namespace covey
