// SPDX-License-Identifier: Apache-2.0
#include "apps/precision_recall.h"

#include <algorithm>
#include <cstddef>

namespace covey {

PrecisionRecall precision_recall(std::vector<ScoredPair> pairs) {
  const auto is_same = [](const ScoredPair& pair) { return pair.same_place; };
  const auto all_same = static_cast<double>(std::count_if(pairs.begin(), pairs.end(), is_same));
  PrecisionRecall result;
  if (all_same == 0) return result;
  std::sort(pairs.begin(), pairs.end(),
            [](const ScoredPair& a, const ScoredPair& b) { return a.score > b.score; });
  double same = 0, recall_before = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    same += pairs[i].same_place ? 1 : 0;
    if (i + 1 < pairs.size() && pairs[i + 1].score == pairs[i].score) continue;
    const OperatingPoint point{pairs[i].score, same / static_cast<double>(i + 1), same / all_same};
    result.average_precision += (point.recall - recall_before) * point.precision;
    recall_before = point.recall;
    if (point.precision == 1) result.recall_at_full_precision = point.recall;
    result.curve.push_back(point);
  }
  return result;
}

}  // namespace covey
