// SPDX-License-Identifier: Apache-2.0
//
// ORB descriptors to train a vocabulary on: from the corners that the tracker would begin with.
#pragma once

#include <cstddef>
#include <filesystem>
#include <vector>

#include "estimator/measurements.h"

namespace covey {

struct TrainingSet {
  std::size_t images = 0;
  std::vector<BinaryDescriptor> descriptors;

  void add(const TrainingSet& other);
};

// `folder`: a dataset (find_drones in dataset.h) or PNG files. At most `images_per_camera` of each
// drone or folder, evenly spread. Descriptors are oriented by the world, as in flight: from the
// ground truth where there is one, otherwise cameras are taken to have been held upright. Throws
// std::runtime_error naming the folder or file that is wrong.
[[nodiscard]] TrainingSet describe_training_images(const std::filesystem::path& folder,
                                                   std::size_t images_per_camera);

}  // namespace covey
