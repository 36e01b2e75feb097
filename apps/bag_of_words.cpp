// SPDX-License-Identifier: Apache-2.0
#include "apps/bag_of_words.h"

#include <cmath>

namespace covey {

WordCounts count_words(const Vocabulary& vocabulary,
                       const std::vector<BinaryDescriptor>& features) {
  WordCounts counts;
  for (const BinaryDescriptor& feature : features) ++counts[nearest_word(vocabulary, feature)];
  return counts;
}

BagOfWords::BagOfWords(std::size_t words, const std::vector<WordCounts>& places)
    : weights_(words, 0) {
  for (const WordCounts& place : places) {
    for (const auto& [word, count] : place) ++weights_[word];
  }
  const auto all = static_cast<double>(places.size());
  for (double& weight : weights_) weight = weight > 0 ? std::log(all / weight) : 0;
}

double BagOfWords::score(const WordCounts& a, const WordCounts& b) const {
  const double norm = std::sqrt(product(a, a) * product(b, b));
  return norm > 0 ? product(a, b) / norm : 0;
}

double BagOfWords::product(const WordCounts& a, const WordCounts& b) const {
  double sum = 0;
  for (const auto& [word, count] : a) {
    const auto other = b.find(word);
    if (other != b.end()) sum += weights_[word] * weights_[word] * count * other->second;
  }
  return sum;
}

}  // namespace covey
