// SPDX-License-Identifier: Apache-2.0
//
// Precision and recall of the place descriptors on one dataset: each drone's views against the
// views of all other drones.
#pragma once

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "apps/place_survey.h"
#include "apps/precision_recall.h"
#include "frontend/place_recognition.h"

namespace covey {

struct ComparisonConfig {
  double interval_s = 0.5;          // between the views of a drone
  double same_overlap = 0.3;        // views that share at least this show the same place,
  double different_overlap = 0.05;  // less than this another one; between them nobody is asked
  ThermalMode thermal = ThermalMode::kAuto;
  Vocabulary vocabulary;                 // of both VLADs
  std::optional<Vocabulary> many_words;  // of the bag of words, which is left out without them
};

struct DescriptorResult {
  std::string name;  // "paper", "majority", "compact" or "bag"
  double mean_bytes = 0;
  PrecisionRecall figures;
  double first_is_right = 0;  // share of the views, of those that another drone has seen as well,
                              // whose best answer is the same place
};

struct DatasetComparison {
  std::string dataset;
  std::size_t views = 0, same = 0, different = 0;  // the last two are pairs
  std::vector<DescriptorResult> descriptors;
};

// Throws std::runtime_error when it has only one drone, or no ground truth of one.
[[nodiscard]] std::vector<DroneFolder> drones_to_compare(const std::filesystem::path& dataset);

// Throws std::runtime_error for these reasons, too, and when the dataset has no place that two
// drones have seen.
[[nodiscard]] DatasetComparison compare_descriptors(const std::filesystem::path& dataset,
                                                    const ComparisonConfig& config,
                                                    const OnImage& on_image = {});

// The same for views that are at hand.
[[nodiscard]] DatasetComparison compare_descriptors(const std::string& dataset,
                                                    const std::vector<SurveyedView>& views,
                                                    const ComparisonConfig& config);

}  // namespace covey
