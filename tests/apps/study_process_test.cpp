// SPDX-License-Identifier: Apache-2.0
//
// `covey study`, run as a program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/json_file.h"
#include "sim/scenario_motion.h"
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

// Ground truth as recordings have it.
std::string truth_csv(const Trajectory& motion, double rate_hz) {
  std::string csv = "#timestamp,p,p,p,q,q,q,q,v,v,v,bw,bw,bw,ba,ba,ba\n";
  for (int i = 0; i / rate_hz <= motion.duration_s(); ++i) {
    const KinematicState state = motion.at(i / rate_hz);
    const Eigen::Vector3d &p = state.pose.p_world_imu, &v = state.v_world_imu;
    const Eigen::Quaterniond& q = state.pose.q_world_imu;
    csv += std::to_string(1'000'000'000 + nanoseconds(i / rate_hz));
    for (const double value : {p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z(), v.x(), v.y(), v.z(),
                               0.0, 0.0, 0.0, 0.0, 0.0, 0.0})
      csv += "," + std::to_string(value);
    csv += "\n";
  }
  return csv;
}

TEST(StudyProgram, FliesRecordedMotionInARoom) {
  const TemporaryFolder folder;
  FlightRequest request;
  request.scenario = Scenario::kRoom;
  request.agents = 2;
  request.duration_s = 6;
  std::vector<std::string> command = {"study", "ablation", "--scenario", "room", "--seeds", "1"};
  command.emplace_back("--trajectory");
  for (const DronePlan& plan : plan_flights(request))
    command.push_back(folder.write(plan.name + ".csv", truth_csv(plan.trajectory, 20)).string());
  const auto out = folder.path() / "out";
  command.insert(command.end(), {"--begin", "1", "2.5", "--out", out.string()});
  CoveyProcess covey(command);
  ASSERT_EQ(covey.finish(), 0) << covey.output();
  const nlohmann::json summary = read_json_file(out / "summary.json");
  EXPECT_EQ(summary["recorded_trajectories"], 2);
  const nlohmann::json alone = summary["variants"][0];
  EXPECT_EQ(alone["variant"], "alone");
  EXPECT_GT(alone["unaligned_m"], 0);
  EXPECT_LT(alone["unaligned_m"], 0.5);
}

TEST(StudyProgram, SaysHowRecordedMotionIsFlown) {
  const TemporaryFolder folder;
  const std::string truth = folder.write("truth.csv", "#\n").string();
  const auto expect_refused = [&](const std::vector<std::string>& arguments, const char* why) {
    std::vector<std::string> command = {"study"};
    command.insert(command.end(), arguments.begin(), arguments.end());
    command.insert(command.end(), {"--out", (folder.path() / "out").string()});
    CoveyProcess covey(command);
    EXPECT_NE(covey.finish(), 0) << why;
    EXPECT_THAT(covey.output(), HasSubstr(why));
  };
  expect_refused({"scaling", "--trajectory", truth, truth}, "--trajectory is for ablation");
  expect_refused({"ablation", "--trajectory", truth, truth}, "add --scenario room");
  expect_refused({"ablation", "--scenario", "room", "--trajectory", truth}, "two or more");
  expect_refused({"ablation", "--begin", "3"}, "--begin needs one for each --trajectory");
  expect_refused({"ablation", "--drones", "3", "--trajectory", truth, truth}, "excludes");
  expect_refused({"ablation", "--scenario", "room", "--trajectory", truth, truth}, "truth.csv");
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "out"));
}

}  // namespace
}  // namespace covey
