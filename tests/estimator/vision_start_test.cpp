// SPDX-License-Identifier: Apache-2.0
#include "estimator/vision_start.h"

#include <gtest/gtest.h>

#include "tests/estimator/filled_window.h"

namespace covey {
namespace {

// What is seen before the start does not hang on how many features an update may use.
TEST(VisionStart, WithFewFeaturesOrNoneThereIsAGlimpseAllTheSame) {
  for (const int features : {0, 5}) {
    SCOPED_TRACE(features);
    FilledWindow window = filled_window(3);
    window.config.max_slam_features = 0;
    window.config.max_msckf_features = features;
    VisionStart start(window.config, window.state.capacity());
    EXPECT_TRUE(start.glimpse(window.state, some_tracks(window, 0, 40)));
  }
}

}  // namespace
}  // namespace covey
