// SPDX-License-Identifier: Apache-2.0
//
// k-majority clustering (Grana et al., "A fast approach for integrating ORB descriptors in the bag
// of words model", 2013): k-means for binary vectors, with Hamming distance and a vote per bit.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "frontend/place_recognition.h"

namespace covey {

struct TrainingConfig {
  int words = 64;
  int max_iterations = 50;
  int restarts = 5;  // of which the one with the least mean distance is kept
  std::uint64_t seed = 1;
};

struct TrainedVocabulary {
  Vocabulary vocabulary;
  int iterations = 0;
  bool converged = false;         // no descriptor changed its word
  double mean_distance_bits = 0;  // of a descriptor to its word
};

// Told now and then how many of the trainings are done; what it throws ends them.
using OnTraining = std::function<void(int done)>;

// Throws std::runtime_error if there are fewer different descriptors than words. Same input, same
// output.
[[nodiscard]] TrainedVocabulary train_vocabulary(const std::vector<BinaryDescriptor>& descriptors,
                                                 const TrainingConfig& config,
                                                 const OnTraining& on_training = {});

}  // namespace covey
