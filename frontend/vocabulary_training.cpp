// SPDX-License-Identifier: Apache-2.0
#include "frontend/vocabulary_training.h"

#include <algorithm>
#include <array>
#include <random>
#include <set>
#include <stdexcept>
#include <string>

namespace covey {
namespace {

using Descriptors = std::vector<BinaryDescriptor>;
using Alive = std::function<void()>;  // called every now and then

// 0 <= result < bound. std::uniform_int_distribution may differ between standard libraries.
std::uint64_t draw(std::mt19937_64& random, std::uint64_t bound) { return random() % bound; }

// k-means++ (Arthur and Vassilvitskii 2007): each next word is a descriptor drawn with a
// probability that grows with the square of its distance to the words there are.
Vocabulary spread_words(const Descriptors& descriptors, int words, std::mt19937_64& random,
                        const Alive& alive) {
  Vocabulary vocabulary;
  vocabulary.words.push_back(descriptors[draw(random, descriptors.size())]);
  std::vector<std::uint64_t> weights(descriptors.size(), 65536);  // 256 bits, squared
  while (static_cast<int>(vocabulary.words.size()) < words) {
    std::uint64_t total = 0;
    for (std::size_t i = 0; i < descriptors.size(); ++i) {
      const auto d =
          static_cast<std::uint64_t>(hamming_distance(descriptors[i], vocabulary.words.back()));
      weights[i] = std::min(weights[i], d * d);
      total += weights[i];
    }
    std::uint64_t left = draw(random, total);
    std::size_t chosen = 0;
    while (left >= weights[chosen]) left -= weights[chosen++];
    vocabulary.words.push_back(descriptors[chosen]);
    alive();
  }
  return vocabulary;
}

struct Assignment {
  std::vector<std::size_t> word;  // of each descriptor
  std::vector<int> distance;      // to it, bits
};

Assignment assign(const Descriptors& descriptors, const Vocabulary& vocabulary) {
  Assignment assignment;
  for (const BinaryDescriptor& descriptor : descriptors) {
    const std::size_t word = nearest_word(vocabulary, descriptor);
    assignment.word.push_back(word);
    assignment.distance.push_back(hamming_distance(vocabulary.words[word], descriptor));
  }
  return assignment;
}

struct Cluster {
  int members = 0;
  std::array<int, 256> set{};  // how many of them have each bit
};

std::vector<Cluster> count_bits(const Descriptors& descriptors, const Assignment& assignment,
                                std::size_t words) {
  std::vector<Cluster> clusters(words);
  for (std::size_t i = 0; i < descriptors.size(); ++i) {
    Cluster& cluster = clusters[assignment.word[i]];
    ++cluster.members;
    for (int bit = 0; bit < 256; ++bit) cluster.set[bit] += descriptors[i][bit / 8] >> bit % 8 & 1;
  }
  return clusters;
}

BinaryDescriptor majority(const Cluster& cluster) {
  BinaryDescriptor word{};
  for (int bit = 0; bit < 256; ++bit) {
    if (2 * cluster.set[bit] > cluster.members) {
      word[bit / 8] |= static_cast<std::uint8_t>(1 << bit % 8);
    }
  }
  return word;
}

// A word that nobody chose starts again at the descriptor that is worst served.
Vocabulary move_words(const Descriptors& descriptors, Assignment assignment, std::size_t words) {
  Vocabulary vocabulary;
  for (const Cluster& cluster : count_bits(descriptors, assignment, words)) {
    if (cluster.members > 0) {
      vocabulary.words.push_back(majority(cluster));
      continue;
    }
    const auto worst = std::max_element(assignment.distance.begin(), assignment.distance.end());
    vocabulary.words.push_back(descriptors[worst - assignment.distance.begin()]);
    *worst = 0;
  }
  return vocabulary;
}

double mean_of(const std::vector<int>& values) {
  double sum = 0;
  for (const int value : values) sum += value;
  return sum / static_cast<double>(values.size());
}

void check(const Descriptors& descriptors, const TrainingConfig& config) {
  if (config.words < 1 || config.max_iterations < 1 || config.restarts < 1) {
    throw std::runtime_error(
        "vocabulary training: words, max_iterations and restarts must be at least 1");
  }
  const std::size_t different = std::set(descriptors.begin(), descriptors.end()).size();
  if (different < static_cast<std::size_t>(config.words)) {
    throw std::runtime_error("vocabulary training: " + std::to_string(different) +
                             " different descriptors are too few for " +
                             std::to_string(config.words) + " words; give more images");
  }
}

TrainedVocabulary train_once(const Descriptors& descriptors, const TrainingConfig& config,
                             std::mt19937_64& random, const Alive& alive) {
  TrainedVocabulary result;
  result.vocabulary = spread_words(descriptors, config.words, random, alive);
  Assignment assignment = assign(descriptors, result.vocabulary);
  while (result.iterations < config.max_iterations && !result.converged) {
    result.vocabulary = move_words(descriptors, assignment, result.vocabulary.words.size());
    Assignment next = assign(descriptors, result.vocabulary);
    result.converged = next.word == assignment.word;
    assignment = std::move(next);
    ++result.iterations;
    alive();
  }
  result.mean_distance_bits = mean_of(assignment.distance);
  return result;
}

}  // namespace

TrainedVocabulary train_vocabulary(const std::vector<BinaryDescriptor>& descriptors,
                                   const TrainingConfig& config, const OnTraining& on_training) {
  check(descriptors, config);
  std::mt19937_64 random(config.seed);
  int done = 0;
  const Alive alive = [&] {
    if (on_training) on_training(done);
  };
  TrainedVocabulary best = train_once(descriptors, config, random, alive);
  while (++done < config.restarts) {
    TrainedVocabulary next = train_once(descriptors, config, random, alive);
    if (next.mean_distance_bits < best.mean_distance_bits) best = std::move(next);
  }
  alive();
  return best;
}

}  // namespace covey
