// SPDX-License-Identifier: Apache-2.0
#include "estimator/vision_update.h"

#include <gtest/gtest.h>

#include "tests/estimator/filled_window.h"

namespace covey {
namespace {

TEST(VisionUpdate, WhatFailedHasUsedNoTrack) {
  FilledWindow window = filled_window(3);
  make_impossible(window.state, window.state.clone_offset(5) + 3);
  VisionUpdate vision(window.config, window.state.capacity());
  UpdateReport report;
  (void)vision.update_tracks(window.state, some_tracks(window, 0, 20), {}, 0, report);
  EXPECT_EQ(report.failed_updates, 1);
  EXPECT_EQ(report.msckf_used, 0);
}

// Where variances of the poses are negative, the variance of the depth is too, and has no root.
TEST(VisionUpdate, ADepthOfUnknownErrorIsNotKnown) {
  FilledWindow window = filled_window(3);
  const int n = window.state.dimension();
  window.state.correct(Eigen::VectorXd::Zero(n), Eigen::MatrixXd::Identity(n, n),
                       Eigen::MatrixXd::Identity(n, n));
  VisionUpdate vision(window.config, window.state.capacity());
  UpdateReport report;
  EXPECT_TRUE(vision.update_tracks(window.state, some_tracks(window, 0, 5), {}, 0, report).empty());
  EXPECT_EQ(report.msckf_untriangulated, 5);
}

}  // namespace
}  // namespace covey
