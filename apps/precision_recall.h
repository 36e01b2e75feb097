// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace covey {

struct ScoredPair {
  double score = 0;
  bool same_place = false;
};

// Of the pairs that score at least `threshold`.
struct OperatingPoint {
  double threshold = 0;
  double precision = 0;  // share of them that are the same place
  double recall = 0;     // share of the same places that are among them
};

struct PrecisionRecall {
  std::vector<OperatingPoint> curve;  // recall rises
  double average_precision = 0;       // mean precision over the same places as they come in
  double recall_at_full_precision = 0;
};

// Pairs that score alike come in together. Without any same place: nothing.
[[nodiscard]] PrecisionRecall precision_recall(std::vector<ScoredPair> pairs);

}  // namespace covey
