// SPDX-License-Identifier: Apache-2.0
#include "apps/team_study.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "apps/json_file.h"
#include "apps/study_report.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using ::testing::HasSubstr;

StudyConfig short_study() {
  StudyConfig config;
  config.scenario = "castle_parallel";
  config.duration_s = 4;
  config.seeds = 1;
  return config;
}

TEST(TeamStudy, TwoDronesThatFlyTogetherOverlapAndTalk) {
  const ScalingPoint point = study_team_size(short_study(), 2);
  EXPECT_EQ(point.drones, 2);
  EXPECT_EQ(point.overlapping_peers, 1);
  EXPECT_GT(point.question_bytes_per_s, 0);
  EXPECT_GT(point.answer_bytes_per_s, 0);
  // With one peer, saying once and saying to each is the same.
  EXPECT_NEAR(point.sent_bytes_per_s, point.question_bytes_per_s + point.answer_bytes_per_s, 1e-6);
  EXPECT_NE(point.alone.unaligned_m, point.together.unaligned_m);
}

TEST(TeamStudy, FiguresAreWrittenAndReadBack) {
  const TemporaryFolder folder;
  const auto& out = folder.path();
  const std::vector<ScalingPoint> points = {study_team_size(short_study(), 2)};
  write_scaling(out, short_study(), points);
  const nlohmann::json written = read_json_file(out / "summary.json");
  EXPECT_EQ(written["scenario"], "castle_parallel");
  EXPECT_EQ(written["points"][0]["drones"], 2);
  EXPECT_EQ(written["points"][0]["together"]["aligned_m"], points[0].together.aligned_m);
  EXPECT_TRUE(std::filesystem::exists(out / "scaling.csv"));
  EXPECT_TRUE(std::filesystem::exists(out / "scaling.svg"));
  EXPECT_TRUE(is_scaling(out));
  EXPECT_FALSE(is_ablation(out));
  (void)folder.write("notes.txt", "mine");
  EXPECT_FALSE(is_scaling(out)) << "it would be lost with the rest";
}

TEST(TeamStudy, AScenarioThatIsNotThereIsNamed) {
  StudyConfig config = short_study();
  config.scenario = "moon";
  try {
    (void)study_team_size(config, 2);
    FAIL() << "flew on the moon";
  } catch (const std::runtime_error& error) {
    EXPECT_THAT(error.what(), HasSubstr("no scenario 'moon'"));
  }
}

}  // namespace
}  // namespace covey
