// SPDX-License-Identifier: Apache-2.0
//
// The usual way to recognise a place, for comparison: how often each word of a large vocabulary
// occurs, rare words counting more (tf-idf, Sivic and Zisserman 2003).
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "frontend/place_recognition.h"

namespace covey {

using WordCounts = std::map<std::size_t, int>;  // word, how often

[[nodiscard]] WordCounts count_words(const Vocabulary& vocabulary,
                                     const std::vector<BinaryDescriptor>& features);

class BagOfWords {
 public:
  // Rare is what few of `places` hold.
  BagOfWords(std::size_t words, const std::vector<WordCounts>& places);

  // Cosine between the weighted counts, 0..1.
  [[nodiscard]] double score(const WordCounts& a, const WordCounts& b) const;

 private:
  [[nodiscard]] double product(const WordCounts& a, const WordCounts& b) const;

  std::vector<double> weights_;  // inverse document frequency of each word
};

}  // namespace covey
