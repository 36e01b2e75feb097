// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_experiment.h"

#include <cstdio>
#include <set>
#include <stdexcept>
#include <utility>

#include "apps/config_file.h"
#include "apps/config_json.h"
#include "apps/config_visitor.h"
#include "apps/json_file.h"

namespace covey {
namespace {

using Json = nlohmann::json;

constexpr double kLongTime_s = 1e5;
constexpr Range kTime_s{0, kLongTime_s};
constexpr Range kDelay_ms{0, 1e4};
constexpr Range kLoss{0, 0.99};
constexpr Range kBurst{1, 1e6};
constexpr Range kRate_mbit{0, 1e5};

// One object of the file. Keys that nobody asked for are refused when it is done with.
class StrictObject {
 public:
  StrictObject(const Json& json, std::string where, std::string prefix = "")
      : json_(json), where_(std::move(where)), prefix_(std::move(prefix)) {
    if (!json_.is_object()) {
      throw std::runtime_error(
          where_ + ": " + (prefix_.empty() ? "not a JSON object" : "'" + name() + "' is none"));
    }
  }

  [[nodiscard]] bool has(const char* key) const { return json_.contains(key); }

  void number(const char* key, double& value, Range range) {
    if (const Json* found = find(key)) value = number_in(*found, key, range);
  }
  void numbers(const char* key, std::vector<double>& values, Range range) {
    if (const Json* found = find(key)) {
      values.clear();
      for (const Json& item : listed(*found)) values.push_back(number_in(item, key, range));
      if (values.empty()) fail(key, "is empty");
    }
  }
  template <typename Integer>
  void count(const char* key, Integer& value, Range range) {
    if (const Json* found = find(key)) value = integer_in<Integer>(*found, key, range);
  }
  template <typename Integer>
  void counts(const char* key, std::vector<Integer>& values, Range range) {
    if (const Json* found = find(key)) {
      values.clear();
      for (const Json& item : listed(*found)) {
        values.push_back(integer_in<Integer>(item, key, range));
      }
      if (values.empty()) fail(key, "is empty");
    }
  }
  void text(const char* key, std::string& value) {
    if (const Json* found = find(key)) value = text_in(*found, key);
  }
  void texts(const char* key, std::vector<std::string>& values) {
    if (const Json* found = find(key)) {
      values.clear();
      for (const Json& item : listed(*found)) values.push_back(text_in(item, key));
      if (values.empty()) fail(key, "is empty");
    }
  }
  void flag(const char* key, bool& value) {
    if (const Json* found = find(key)) {
      if (!found->is_boolean()) fail(key, "is neither true nor false: " + found->dump());
      value = found->get<bool>();
    }
  }

  // Nothing if the key is not there.
  const Json* find(const char* key) {
    known_.emplace_back(key);
    const auto found = json_.find(key);
    return found == json_.end() ? nullptr : &*found;
  }
  // Each object in the list of that name.
  std::vector<StrictObject> objects(const char* key) {
    std::vector<StrictObject> objects;
    const Json* found = find(key);
    if (found == nullptr) return objects;
    if (!found->is_array()) fail(key, "is not a list of objects");
    for (const Json& item : *found) objects.emplace_back(item, where_, prefix_ + key + ".");
    return objects;
  }

  void require(const char* key) const {
    if (!has(key)) fail(key, "is missing");
  }
  void refuse_others() const {
    for (const auto& [key, value] : json_.items()) {
      bool found = false;
      for (const std::string& name : known_) found = found || name == key;
      if (!found) throw std::runtime_error(where_ + ": unknown key '" + prefix_ + key + "'");
    }
  }
  [[noreturn]] void fail(const std::string& key, const std::string& what) const {
    throw std::runtime_error(where_ + ": '" + prefix_ + key + "' " + what);
  }

 private:
  [[nodiscard]] std::string name() const { return prefix_.substr(0, prefix_.size() - 1); }

  // A single value stands for a list of one.
  static std::vector<Json> listed(const Json& json) {
    if (json.is_array()) return json.get<std::vector<Json>>();
    return {json};
  }
  [[nodiscard]] double number_in(const Json& json, const char* key, Range range) const {
    if (!json.is_number()) fail(key, "is not a number: " + json.dump());
    const auto value = json.get<double>();
    if (!(value >= range.min && value <= range.max)) {
      fail(key, "is out of range (" + range_text(range) + "): " + json.dump());
    }
    return value;
  }
  template <typename Integer>
  [[nodiscard]] Integer integer_in(const Json& json, const char* key, Range range) const {
    if (!json.is_number_integer()) fail(key, "is not a whole number: " + json.dump());
    return static_cast<Integer>(number_in(json, key, range));
  }
  [[nodiscard]] std::string text_in(const Json& json, const char* key) const {
    if (!json.is_string()) fail(key, "is not a text in quotes: " + json.dump());
    return json.get<std::string>();
  }

  const Json& json_;
  std::string where_, prefix_;
  std::vector<std::string> known_;
};

LabVariant read_variant(StrictObject& object) {
  for (const char* key : {"name", "config"}) object.require(key);
  LabVariant variant;
  object.text("name", variant.name);
  constexpr char kAllowed[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789-";
  if (variant.name.find_first_not_of(kAllowed) != std::string::npos) {
    object.fail("name", "is part of a folder's name: letters, digits and '-' only");
  }
  variant.config = *object.find("config");
  object.refuse_others();
  return variant;
}

void read_grid(StrictObject& object, LabGrid& grid) {
  object.counts("drones", grid.drones, {0, kMaxAgents});
  object.texts("profiles", grid.profiles);
  object.texts("exchanges", grid.exchanges);
  for (const std::string& exchange : grid.exchanges) {
    if (!exchange_from_name(exchange)) {
      object.fail("exchanges", "knows compact, paper and naive, not '" + exchange + "'");
    }
  }
  std::vector<LabVariant> variants;
  for (StrictObject& variant : object.objects("variants")) {
    variants.push_back(read_variant(variant));
  }
  if (!variants.empty()) grid.variants = std::move(variants);
  object.numbers("loss", grid.loss, kLoss);
  object.numbers("mean_burst", grid.mean_burst, kBurst);
  object.numbers("rate_mbit", grid.rate_mbit, kRate_mbit);
  object.numbers("delay_ms", grid.delay_ms, kDelay_ms);
  object.counts("seeds", grid.seeds, {0, 1e9});
  object.count("repeats", grid.repeats, {1, 1000});
}

LabLink read_link_of(StrictObject& object, const LabExperiment& experiment) {
  object.require("from");
  object.require("to");
  LabLink link;
  object.text("from", link.from);
  object.text("to", link.to);
  object.number("loss", link.quality.loss, kLoss);
  object.number("mean_burst", link.quality.mean_burst, kBurst);
  double rate_mbit = 0, delay_ms = 0;
  object.number("rate_mbit", rate_mbit, kRate_mbit);
  object.number("delay_ms", delay_ms, kDelay_ms);
  object.refuse_others();
  link.quality.rate_bit_per_s = 1e6 * rate_mbit;
  link.quality.delay_s = 1e-3 * delay_ms;
  link.quality.jitter_s = 1e-3 * experiment.jitter_ms;
  link.quality.queue_s = 1e-3 * experiment.queue_ms;
  return link;
}

LabPartition read_partition(StrictObject& object) {
  for (const char* key : {"from_s", "until_s", "apart"}) object.require(key);
  LabPartition partition;
  object.number("from_s", partition.from_s, kTime_s);
  object.number("until_s", partition.until_s, kTime_s);
  object.texts("apart", partition.apart);
  object.refuse_others();
  if (partition.until_s <= partition.from_s) object.fail("until_s", "is not after from_s");
  return partition;
}

void read_network(StrictObject& object, LabExperiment& experiment, const std::string& file) {
  object.number("jitter_ms", experiment.jitter_ms, kDelay_ms);
  object.number("queue_ms", experiment.queue_ms, kDelay_ms);
  for (StrictObject& link : object.objects("links")) {
    experiment.links.push_back(read_link_of(link, experiment));
  }
  if (const Json* json = object.find("radio")) {
    StrictObject radio(*json, file, "radio.");
    radio.require("half_range_m");
    radio.number("half_range_m", experiment.range.half_range_m, {0.1, 1e6});
    radio.number("steepness", experiment.range.steepness, {0.1, 100});
    radio.refuse_others();
  }
  for (StrictObject& partition : object.objects("partitions")) {
    experiment.partitions.push_back(read_partition(partition));
  }
  if (const Json* json = object.find("kills")) {
    StrictObject kills(*json, file, "kills.");
    kills.require("count");
    kills.count("count", experiment.kills.count, {1, 1000});
    kills.number("again_after_s", experiment.kills.again_after_s, kTime_s);
    kills.refuse_others();
  }
}

// A mistake in the agents' settings shows now, not in the first flight: merged as for a flight.
void check_agents(const LabExperiment& experiment, const std::string& file) {
  AgentConfig base;
  merge_config(experiment.config, file + ", 'config'", base);
  for (const LabVariant& variant : experiment.grid.variants) {
    Json settings = experiment.config;
    settings.merge_patch(variant.config);
    AgentConfig config;
    merge_config(settings, file + ", 'variants.config'", config);
    for (const std::string& profile : experiment.grid.profiles) {
      AgentConfig flown = config;
      merge_config(Json{{"link", {{"profile", profile}}}}, file + ", 'profiles'", flown);
    }
  }
}

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

}  // namespace

std::string LabCell::name() const {
  std::string name = profile + "_" + exchange + "_" + std::to_string(drones) + "drones_loss" +
                     number(quality.loss) + "_burst" + number(quality.mean_burst);
  name += quality.rate_bit_per_s > 0 ? "_" + number(1e-6 * quality.rate_bit_per_s) + "mbit" : "";
  name += variant.name.empty() ? "" : "_" + variant.name;
  return name + "_" + number(1e3 * quality.delay_s) + "ms_seed" + std::to_string(seed) + "_run" +
         std::to_string(repeat);
}

LabExperiment experiment_from_json(const Json& json, const std::string& file) {
  StrictObject object(json, file);
  LabExperiment experiment;
  object.require("name");
  object.text("name", experiment.name);
  object.text("about", experiment.about);
  object.text("dataset", experiment.dataset);
  object.text("scenario", experiment.scenario);
  object.count("scenario_seed", experiment.scenario_seed, {0, 1e9});
  object.count("legs", experiment.legs, {1, 1000});
  object.number("rate", experiment.rate, {1, 200});
  object.flag("fly", experiment.fly);
  object.flag("alone", experiment.alone);
  object.number("settle_s", experiment.settle_s, kTime_s);
  object.number("hold_s", experiment.hold_s, kTime_s);
  object.number("pace", experiment.pace, {0.01, 100});
  object.number("seconds", experiment.seconds, kTime_s);
  read_grid(object, experiment.grid);
  read_network(object, experiment, file);
  if (const Json* config = object.find("config")) experiment.config = *config;
  object.refuse_others();
  check_agents(experiment, file);
  require_different(cells_of(experiment), file);
  return experiment;
}

LabExperiment read_experiment(const std::filesystem::path& file) {
  return experiment_from_json(read_json_file(file), file.string());
}

void require_different(const std::vector<LabCell>& cells, const std::string& file) {
  std::set<std::string> names;
  for (const LabCell& cell : cells) {
    if (names.insert(cell.name()).second) continue;
    throw std::runtime_error(file + ": two flights would be named " + cell.name() +
                             ": list no value twice, and name every variant differently");
  }
}

std::vector<LabCell> cells_of(const LabExperiment& experiment) {
  const LabGrid& grid = experiment.grid;
  std::vector<LabCell> cells{LabCell{}};
  cells.front().quality.jitter_s = 1e-3 * experiment.jitter_ms;
  cells.front().quality.queue_s = 1e-3 * experiment.queue_ms;
  // One more dimension: each cell so far, with each of the values.
  const auto spread = [&cells](const auto& values, const auto& set) {
    std::vector<LabCell> wider;
    for (const auto& value : values) {
      for (LabCell cell : cells) {
        set(cell, value);
        wider.push_back(std::move(cell));
      }
    }
    cells = std::move(wider);
  };
  spread(grid.delay_ms, [](LabCell& c, double ms) { c.quality.delay_s = 1e-3 * ms; });
  spread(grid.rate_mbit, [](LabCell& c, double mbit) { c.quality.rate_bit_per_s = 1e6 * mbit; });
  spread(grid.mean_burst, [](LabCell& c, double frames) { c.quality.mean_burst = frames; });
  spread(grid.loss, [](LabCell& c, double share) { c.quality.loss = share; });
  spread(grid.exchanges, [](LabCell& c, const std::string& mode) { c.exchange = mode; });
  spread(grid.profiles, [](LabCell& c, const std::string& profile) { c.profile = profile; });
  spread(grid.variants, [](LabCell& c, const LabVariant& variant) { c.variant = variant; });
  spread(grid.drones, [](LabCell& c, int drones) { c.drones = drones; });
  spread(grid.seeds, [](LabCell& c, std::uint64_t seed) { c.seed = seed; });
  std::vector<int> repeats;
  for (int i = 1; i <= grid.repeats; ++i) repeats.push_back(i);
  spread(repeats, [](LabCell& c, int repeat) { c.repeat = repeat; });
  return cells;
}

}  // namespace covey
