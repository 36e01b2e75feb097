// SPDX-License-Identifier: Apache-2.0
#include "apps/place_comparison.h"

#include <algorithm>
#include <functional>
#include <stdexcept>

#include "apps/bag_of_words.h"

namespace covey {
namespace {

using Score = std::function<double(std::size_t, std::size_t)>;  // of two views, by index

// Two views of different drones that certainly show, or certainly do not show, the same place.
struct ViewPair {
  std::size_t a = 0, b = 0;
  bool same = false;
};

std::vector<ViewPair> decided_pairs(const std::vector<SurveyedView>& views,
                                    const ComparisonConfig& config) {
  std::vector<ViewPair> pairs;
  for (std::size_t a = 0; a < views.size(); ++a) {
    for (std::size_t b = a + 1; b < views.size(); ++b) {
      if (views[a].drone == views[b].drone) continue;
      const double overlap = view_overlap(views[a], views[b]);
      if (overlap >= config.same_overlap) pairs.push_back({a, b, true});
      if (overlap < config.different_overlap) pairs.push_back({a, b, false});
    }
  }
  return pairs;
}

// The best answer to a view so far.
struct FirstAnswer {
  double score = -1;
  bool right = false;
  bool possible = false;  // somebody has seen the place

  void hear(double other_score, bool same) {
    possible = possible || same;
    if (other_score <= score) return;
    score = other_score;
    right = same;
  }
};

double first_is_right(const std::vector<FirstAnswer>& answers) {
  double right = 0, possible = 0;
  for (const FirstAnswer& answer : answers) {
    possible += answer.possible ? 1 : 0;
    right += answer.possible && answer.right ? 1 : 0;
  }
  return possible > 0 ? right / possible : 0;
}

DescriptorResult judge(const std::string& name, const std::vector<ViewPair>& pairs,
                       std::size_t views, const Score& score) {
  std::vector<ScoredPair> scored;
  std::vector<FirstAnswer> answers(views);
  for (const ViewPair& pair : pairs) {
    const double value = score(pair.a, pair.b);
    scored.push_back({value, pair.same});
    answers[pair.a].hear(value, pair.same);
    answers[pair.b].hear(value, pair.same);
  }
  DescriptorResult result;
  result.name = name;
  result.figures = precision_recall(std::move(scored));
  result.first_is_right = first_is_right(answers);
  return result;
}

DescriptorResult judge_mode(const std::string& name, PlaceMode mode,
                            const std::vector<SurveyedView>& views,
                            const std::vector<ViewPair>& pairs, const Vocabulary& vocabulary) {
  std::vector<PlaceDescriptor> places;
  double bytes = 0;
  for (const SurveyedView& view : views) {
    places.push_back(describe_place(vocabulary, mode, view.features));
    bytes += static_cast<double>(places.back().size());
  }
  DescriptorResult result = judge(name, pairs, views.size(), [&](std::size_t a, std::size_t b) {
    return place_score(mode, places[a], places[b]);
  });
  result.mean_bytes = bytes / static_cast<double>(views.size());
  return result;
}

// Two bytes for each word in the view.
DescriptorResult judge_bag(const std::vector<SurveyedView>& views,
                           const std::vector<ViewPair>& pairs, const Vocabulary& vocabulary) {
  std::vector<WordCounts> places;
  double bytes = 0;
  for (const SurveyedView& view : views) {
    places.push_back(count_words(vocabulary, view.features));
    bytes += 2 * static_cast<double>(view.features.size());
  }
  const BagOfWords bag(vocabulary.words.size(), places);
  DescriptorResult result = judge("bag", pairs, views.size(), [&](std::size_t a, std::size_t b) {
    return bag.score(places[a], places[b]);
  });
  result.mean_bytes = bytes / static_cast<double>(views.size());
  return result;
}

}  // namespace

std::vector<DroneFolder> drones_to_compare(const std::filesystem::path& dataset) {
  std::vector<DroneFolder> drones = find_drones(dataset);
  if (drones.size() < 2) {
    throw std::runtime_error(dataset.string() + ": has one drone; two or more see each other's");
  }
  for (const DroneFolder& drone : drones) require_ground_truth(drone);
  return drones;
}

DatasetComparison compare_descriptors(const std::filesystem::path& dataset,
                                      const ComparisonConfig& config, const OnImage& on_image) {
  std::vector<SurveyedView> views;
  for (const DroneFolder& drone : drones_to_compare(dataset)) {
    const std::vector<SurveyedView> seen =
        survey_flight(drone, config.interval_s, config.thermal, on_image);
    views.insert(views.end(), seen.begin(), seen.end());
  }
  return compare_descriptors(dataset_name(dataset), views, config);
}

DatasetComparison compare_descriptors(const std::string& dataset,
                                      const std::vector<SurveyedView>& views,
                                      const ComparisonConfig& config) {
  const std::vector<ViewPair> pairs = decided_pairs(views, config);
  DatasetComparison result;
  result.dataset = dataset;
  result.views = views.size();
  result.same = static_cast<std::size_t>(
      std::count_if(pairs.begin(), pairs.end(), [](const ViewPair& pair) { return pair.same; }));
  result.different = pairs.size() - result.same;
  if (result.same == 0) {
    throw std::runtime_error(dataset + ": no two drones have seen the same place");
  }
  const auto add_mode = [&](const std::string& name, PlaceMode mode) {
    result.descriptors.push_back(judge_mode(name, mode, views, pairs, config.vocabulary));
  };
  add_mode("paper", PlaceMode::kPaper);
  add_mode("majority", PlaceMode::kMajority);
  if (config.many_words) result.descriptors.push_back(judge_bag(views, pairs, *config.many_words));
  add_mode("compact", PlaceMode::kCompact);
  return result;
}

}  // namespace covey
