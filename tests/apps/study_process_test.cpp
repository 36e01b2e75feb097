// SPDX-License-Identifier: Apache-2.0
//
// `covey study`, run as a program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/apps/covey_process.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using ::testing::HasSubstr;

std::vector<std::string> short_study(const std::string& what, const std::filesystem::path& out,
                                     const std::vector<std::string>& more = {},
                                     const std::string& seeds = "1") {
  std::vector<std::string> command = {"study", what, "--scenario", "castle_parallel"};
  for (const char* const word : {"--seconds", "3", "--drones", "2", "--sizes", "2"})
    command.emplace_back(word);
  command.insert(command.end(), {"--seeds", seeds, "--out", out.string()});
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

TEST(StudyProgram, ReplacesNothingButAStudyOfItsKindAndOnlyWhenAsked) {
  const TemporaryFolder folder;
  const auto summary = folder.write("run/summary.json", "of a team");
  for (const std::vector<std::string>& force : {std::vector<std::string>{}, {"--force"}}) {
    CoveyProcess covey(short_study("scaling", folder.path() / "run", force));
    EXPECT_EQ(covey.finish(), 1);
    EXPECT_THAT(covey.output(), HasSubstr("choose another --out"));
  }
  EXPECT_EQ(file_content(summary), "of a team");

  const auto out = folder.path() / "scaling";
  ASSERT_EQ(CoveyProcess(short_study("scaling", out)).finish(), 0);
  EXPECT_EQ(CoveyProcess(short_study("scaling", out)).finish(), 1);
  EXPECT_EQ(CoveyProcess(short_study("scaling", out, {"--force"})).finish(), 0);
  EXPECT_EQ(CoveyProcess(short_study("ablation", out, {"--force"})).finish(), 1);
  EXPECT_FALSE(std::filesystem::exists(out / "ablation.csv"));
}

TEST(StudyProgram, ShowsHowFarItIsAndIsStoppedAtAnyImage) {
  const TemporaryFolder folder;
  for (const char* what : {"scaling", "ablation"}) {
    CoveyProcess covey(short_study(what, folder.path() / "out", {}, "1000"));
    ASSERT_TRUE(covey.wait_for("0 flights")) << what;
    covey.send(SIGINT);
    EXPECT_EQ(covey.finish(), 1);
    EXPECT_THAT(covey.output(), HasSubstr("study: interrupted, nothing is written"));
    EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  }
}

}  // namespace
}  // namespace covey
