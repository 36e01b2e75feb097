// SPDX-License-Identifier: Apache-2.0
#include "frontend/place_recognition.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <opencv2/core/hal/hal.hpp>
#include <sstream>
#include <stdexcept>

#include "frontend/compact_place.h"

namespace covey {
namespace {

constexpr std::size_t kBytes = std::tuple_size_v<BinaryDescriptor>;
constexpr int kBits = 8 * static_cast<int>(kBytes);

// How often each bit of the residuals of one word is set.
struct Votes {
  int features = 0;
  std::array<int, kBits> set{};
};

std::vector<Votes> vote(const Vocabulary& vocabulary,
                        const std::vector<BinaryDescriptor>& features) {
  std::vector<Votes> votes(vocabulary.words.size());
  for (const BinaryDescriptor& feature : features) {
    const std::size_t word = nearest_word(vocabulary, feature);
    ++votes[word].features;
    for (int bit = 0; bit < kBits; ++bit) {
      const int residual = feature[bit / 8] ^ vocabulary.words[word][bit / 8];
      votes[word].set[bit] += residual >> (bit % 8) & 1;
    }
  }
  return votes;
}

// The paper's OR keeps a bit that any feature sets, the majority one that more than half of them
// set.
bool keeps(PlaceMode mode, const Votes& votes, int bit) {
  return mode == PlaceMode::kPaper ? votes.set[bit] > 0 : 2 * votes.set[bit] > votes.features;
}

// Bits set in both; |a & b| = (|a| + |b| - |a ^ b|) / 2.
int common_bits(const std::uint8_t* a, const std::uint8_t* b, std::size_t bytes) {
  const int size = static_cast<int>(bytes);
  return (cv::hal::normHamming(a, size) + cv::hal::normHamming(b, size) -
          cv::hal::normHamming(a, b, size)) /
         2;
}

// Paper: s = Hamming(r_j AND r_k) / D_max.
double paper_score(const PlaceDescriptor& a, const PlaceDescriptor& b) {
  assert(a.size() == b.size() && !a.empty());
  return common_bits(a.data(), b.data(), a.size()) / (8.0 * static_cast<double>(a.size()));
}

// Agreement of the words that both hold, +1 for equal and 0 for unrelated bits, over the geometric
// mean of the words that each holds: empty words are no agreement.
double majority_score(const PlaceDescriptor& a, const PlaceDescriptor& b) {
  assert(a.size() == b.size() && a.size() % kBytes == 0);
  int words_a = 0, words_b = 0;
  double agreement = 0;
  for (std::size_t at = 0; at < a.size(); at += kBytes) {
    const bool in_a = cv::hal::normHamming(&a[at], kBytes) > 0;
    const bool in_b = cv::hal::normHamming(&b[at], kBytes) > 0;
    words_a += in_a;
    words_b += in_b;
    if (in_a && in_b) agreement += 1 - 2.0 * cv::hal::normHamming(&a[at], &b[at], kBytes) / kBits;
  }
  if (words_a == 0 || words_b == 0) return 0;
  return std::max(0.0, agreement / std::sqrt(static_cast<double>(words_a) * words_b));
}

PlaceDescriptor describe_vlad(const Vocabulary& vocabulary, PlaceMode mode,
                              const std::vector<BinaryDescriptor>& features) {
  const std::vector<Votes> votes = vote(vocabulary, features);
  PlaceDescriptor place(votes.size() * kBytes, 0);
  for (std::size_t word = 0; word < votes.size(); ++word) {
    bool empty = true;
    for (int bit = 0; bit < kBits; ++bit) {
      if (!keeps(mode, votes[word], bit)) continue;
      place[word * kBytes + bit / 8] |= static_cast<std::uint8_t>(1 << (bit % 8));
      empty = false;
    }
    // All zero means "no feature", so a word that is met exactly shows one bit.
    if (empty && votes[word].features > 0) place[word * kBytes] = 1;
  }
  return place;
}

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  return -1;
}

BinaryDescriptor parse_word(const std::string& line, std::size_t line_number) {
  const auto fail = [&](const std::string& what) {
    return std::runtime_error("vocabulary, line " + std::to_string(line_number) + ": " + what +
                              "; each line is one word of 64 hex digits (0-9, a-f)");
  };
  if (line.size() != 2 * kBytes) throw fail(std::to_string(line.size()) + " characters");
  BinaryDescriptor word{};
  for (std::size_t i = 0; i < kBytes; ++i) {
    const int high = hex_digit(line[2 * i]), low = hex_digit(line[2 * i + 1]);
    if (high < 0 || low < 0) throw fail("not a hex digit");
    word[i] = static_cast<std::uint8_t>(16 * high + low);
  }
  return word;
}

}  // namespace

int hamming_distance(const BinaryDescriptor& a, const BinaryDescriptor& b) {
  return cv::hal::normHamming(a.data(), b.data(), static_cast<int>(a.size()));
}

int hamming_distance(const ShortDescriptor& a, const ShortDescriptor& b) {
  return cv::hal::normHamming(a.data(), b.data(), static_cast<int>(a.size()));
}

std::string to_text(const Vocabulary& vocabulary) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (const BinaryDescriptor& word : vocabulary.words) {
    for (const std::uint8_t byte : word) {
      text += kDigits[byte / 16];
      text += kDigits[byte % 16];
    }
    text += '\n';
  }
  return text;
}

Vocabulary parse_vocabulary(const std::string& text) {
  Vocabulary vocabulary;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    vocabulary.words.push_back(parse_word(line, vocabulary.words.size() + 1));
  }
  if (vocabulary.words.empty()) throw std::runtime_error("vocabulary: no words");
  return vocabulary;
}

std::size_t nearest_word(const Vocabulary& vocabulary, const BinaryDescriptor& descriptor) {
  assert(!vocabulary.words.empty());
  std::size_t best = 0;
  int best_distance = kBits + 1;
  for (std::size_t i = 0; i < vocabulary.words.size(); ++i) {
    const int distance = hamming_distance(vocabulary.words[i], descriptor);
    if (distance < best_distance) {
      best = i;
      best_distance = distance;
    }
  }
  return best;
}

PlaceDescriptor describe_place(const Vocabulary& vocabulary, PlaceMode mode,
                               const std::vector<BinaryDescriptor>& features) {
  return mode == PlaceMode::kCompact ? describe_compact(features)
                                     : describe_vlad(vocabulary, mode, features);
}

bool is_place_size(const Vocabulary& vocabulary, PlaceMode mode, std::size_t bytes) {
  if (mode != PlaceMode::kCompact) return bytes == vocabulary.words.size() * kBytes;
  return bytes > 0 && bytes % kCompactBytes == 0 && bytes <= kCompactCorners * kCompactBytes;
}

double place_score(PlaceMode mode, const PlaceDescriptor& a, const PlaceDescriptor& b) {
  switch (mode) {
    case PlaceMode::kPaper:
      return paper_score(a, b);
    case PlaceMode::kMajority:
      return majority_score(a, b);
    case PlaceMode::kCompact:
      break;
  }
  return common_share(a, b);
}

double default_threshold(PlaceMode mode) {
  switch (mode) {
    case PlaceMode::kPaper:
      return 0.15;
    case PlaceMode::kMajority:
      return 0.20;
    case PlaceMode::kCompact:
      break;
  }
  return 0.012;
}

std::uint64_t vocabulary_hash(const Vocabulary& vocabulary, PlaceMode mode) {
  std::uint64_t hash = 14695981039346656037ull;  // FNV-1a offset basis and prime, 64 bit
  const auto mix = [&hash](std::uint8_t byte) { hash = (hash ^ byte) * 1099511628211ull; };
  mix(static_cast<std::uint8_t>(mode));
  if (mode == PlaceMode::kCompact) return hash;
  for (const BinaryDescriptor& word : vocabulary.words) {
    std::for_each(word.begin(), word.end(), mix);
  }
  return hash;
}

}  // namespace covey
