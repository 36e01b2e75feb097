// SPDX-License-Identifier: Apache-2.0
#include "apps/progress.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace covey {
namespace {

using testing::StartsWith;

std::string shown(std::size_t total, std::size_t done) {
  testing::internal::CaptureStderr();
  Progress(total).show(done);
  return testing::internal::GetCapturedStderr();
}

TEST(Progress, SaysHowManyAreDone) {
  EXPECT_THAT(shown(4, 1), StartsWith("1/4 images"));
  EXPECT_THAT(shown(4, 4), StartsWith("4/4 images"));
}

TEST(Progress, OfNothingIsDone) { EXPECT_THAT(shown(0, 0), StartsWith("0/0 images")); }

}  // namespace
}  // namespace covey
