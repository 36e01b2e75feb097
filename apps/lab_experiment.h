// SPDX-License-Identifier: Apache-2.0
//
// What `covey lab` is to find out, as a JSON file: who flies where, over which links, how often.
// docs/lab.md describes every key.
#pragma once

#include <cstdint>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "sim/link_model.h"

namespace covey {

struct LabPartition {
  double from_s = 0, until_s = 0;  // of the flight
  std::vector<std::string> apart;  // drones, from all others
};

// A link that differs from all others, in one direction.
struct LabLink {
  std::string from, to;
  LinkQuality quality;
};

struct LabKills {
  int count = 0;             // kill -9, at moments and of drones that the seed draws
  double again_after_s = 1;  // then it is started again
};

// Settings of the agents that are compared with each other.
struct LabVariant {
  std::string name;  // empty: the only one
  nlohmann::json config = nlohmann::json::object();
};

// Every combination is flown.
struct LabGrid {
  std::vector<int> drones{0};  // 0: all of the dataset
  std::vector<std::string> profiles{"lossy_wifi"};
  std::vector<std::string> exchanges{"compact"};
  std::vector<LabVariant> variants{LabVariant{}};
  std::vector<double> loss{0}, mean_burst{1}, rate_mbit{0}, delay_ms{0};
  std::vector<std::uint64_t> seeds{1};
  int repeats = 1;
};

struct LabExperiment {
  std::string name, about;
  std::string dataset;   // folder; else
  std::string scenario;  // is simulated
  std::uint64_t scenario_seed = 1;
  int legs = 1;         // as covey simulate --legs
  double rate = 30;     // as --rate
  bool fly = true;      // false: the drones only meet
  bool alone = true;    // false: no drone flies alone first, nothing is compared with that
  double settle_s = 0;  // and then stay in touch so long, uncounted
  double hold_s = 10;   // and so long, counted
  double pace = 1;      // times real time
  double seconds = 0;   // of the recording; 0: all of it
  LabGrid grid;
  double jitter_ms = 0, queue_ms = 200;
  std::vector<LabLink> links;
  RadioRange range;
  std::vector<LabPartition> partitions;
  LabKills kills;
  nlohmann::json config = nlohmann::json::object();  // of the agents
};

// One flight.
struct LabCell {
  int drones = 0;
  std::string profile, exchange;
  LabVariant variant;
  LinkQuality quality;
  std::uint64_t seed = 1;
  int repeat = 1;

  [[nodiscard]] std::string name() const;  // that of its folder, unique in the experiment
};

// Throws std::runtime_error that names file and key.
[[nodiscard]] LabExperiment read_experiment(const std::filesystem::path& file);
[[nodiscard]] LabExperiment experiment_from_json(const nlohmann::json& json,
                                                 const std::string& file);

// In the order they are flown: seeds and repeats last, so that every setting is seen early.
[[nodiscard]] std::vector<LabCell> cells_of(const LabExperiment& experiment);
// Throws std::runtime_error if two of them bear one name: they would share one result.
void require_different(const std::vector<LabCell>& cells, const std::string& file);

}  // namespace covey
