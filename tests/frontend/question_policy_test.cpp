// SPDX-License-Identifier: Apache-2.0
#include "frontend/question_policy.h"

#include <gtest/gtest.h>

#include <optional>

namespace covey {
namespace {

TEST(MayAskBriefly, CornersGoAlongRarelyWhileAnswersMatch) {
  constexpr double kInterval_s = 3;
  const auto briefly = [](double told_s, std::optional<double> found_s, double now_s) {
    QuestionsSoFar so_far{nanoseconds(told_s), {}};
    if (found_s) so_far.found_ns = nanoseconds(*found_s);
    return may_ask_briefly(kInterval_s, so_far, nanoseconds(now_s));
  };
  EXPECT_FALSE(may_ask_briefly(kInterval_s, {}, nanoseconds(1))) << "the first one";
  EXPECT_TRUE(briefly(10, {}, 12.9));
  EXPECT_FALSE(briefly(10, {}, 13)) << "brief ones bring nothing";
  EXPECT_FALSE(briefly(10, 9.9, 13));
  EXPECT_TRUE(briefly(10, 12, 14.9));
  EXPECT_FALSE(briefly(10, 12, 15)) << "nothing any more";
  EXPECT_TRUE(briefly(10, 21.5, 21.9));
  EXPECT_FALSE(briefly(10, 21.9, 22)) << "other peers may need them";
  EXPECT_FALSE(may_ask_briefly(0, {nanoseconds(1), nanoseconds(1)}, nanoseconds(1)));
}

}  // namespace
}  // namespace covey
