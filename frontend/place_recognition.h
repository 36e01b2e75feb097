// SPDX-License-Identifier: Apache-2.0
//
// Place recognition: the ORB descriptors of one image made into one short vector of bytes, and a
// score between two such vectors. The paper gathers them per visual word (a binary VLAD).
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

// Bits in which two descriptors differ.
[[nodiscard]] int hamming_distance(const BinaryDescriptor& a, const BinaryDescriptor& b);
[[nodiscard]] int hamming_distance(const ShortDescriptor& a, const ShortDescriptor& b);

struct Vocabulary {
  std::vector<BinaryDescriptor> words;
};

// One line of 64 hex digits per word, the format of shipped and trained vocabularies.
[[nodiscard]] std::string to_text(const Vocabulary& vocabulary);

// Throws std::runtime_error naming the line that is wrong.
[[nodiscard]] Vocabulary parse_vocabulary(const std::string& text);

// The word nearest to a descriptor; the first of equals. The vocabulary must not be empty.
[[nodiscard]] std::size_t nearest_word(const Vocabulary& vocabulary,
                                       const BinaryDescriptor& descriptor);

enum class PlaceMode {
  kPaper,  // VLAD: residuals (descriptor XOR word) OR-ed per word; score Hamming(a AND b) / D_max
  kMajority,  // VLAD: residuals voted per word and bit; score over words that hold a feature
  kCompact,   // no words: shortened descriptors, matched one by one (compact_place.h)
};

// VLAD: words x 32 bytes; a word without features is all zero. Compact: corners x 8 bytes.
using PlaceDescriptor = std::vector<std::uint8_t>;

[[nodiscard]] PlaceDescriptor describe_place(const Vocabulary& vocabulary, PlaceMode mode,
                                             const std::vector<BinaryDescriptor>& features);

// Whether bytes from a peer have a size that describe_place can give.
[[nodiscard]] bool is_place_size(const Vocabulary& vocabulary, PlaceMode mode, std::size_t bytes);

// 0 (nothing in common) to 1. Both sizes must have passed is_place_size.
[[nodiscard]] double place_score(PlaceMode mode, const PlaceDescriptor& a,
                                 const PlaceDescriptor& b);

// The score from which on an answer is worth a try: in compact mode four in five views of the same
// place pass it around the simulated castle (docs/places.md). It is low because the landmarks of an
// answer, fewer than the corners of a view, have to pass it as well. A VLAD's score says little, so
// nearly every request is answered.
[[nodiscard]] double default_threshold(PlaceMode mode);

// Equal exactly when descriptors of both sides can be compared: same words, same mode (FNV-1a, 64
// bit).
[[nodiscard]] std::uint64_t vocabulary_hash(const Vocabulary& vocabulary, PlaceMode mode);

}  // namespace covey
