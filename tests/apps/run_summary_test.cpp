// SPDX-License-Identifier: Apache-2.0
#include "apps/run_summary.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

RunSummary example() {
  AgentSummary agent;
  agent.frames = 270;
  agent.frames_dropped = 2;
  agent.initialised_after_s = 1.5;
  agent.distance_m = 30.1;
  AccuracySummary accuracy;
  accuracy.none = {0.4, 0.3, 0.2, {}};
  accuracy.posyaw = {0.04, 0.03, 0.02, {}};
  accuracy.se3 = {0.035, 0.03, 0.02, {}};
  accuracy.sim3 = {0.03, 0.02, 0.01, 1.002};
  accuracy.rotation_none_deg = 1.5;
  accuracy.rotation_posyaw_deg = 0.5;
  accuracy.rotation_se3_deg = 0.25;
  accuracy.nees_position = 2.9;
  accuracy.nees_orientation = 3.1;
  agent.accuracy = accuracy;
  agent.cpu_ms_per_frame = 7.5;
  agent.max_rss_mib = 80;
  agent.max_cpu_percent = 99;
  agent.stage_ms.track = 3.5;
  agent.stage_ms.peer = 0.25;
  agent.mean_tracks_per_frame = 180;
  agent.mean_track_length = 14.5;
  LinkSummary link;
  link.request = {9, 18, 18432};
  link.message = {7, 6, 41300, 55, 4, 1};
  link.wire_bytes_sent = 70000;
  agent.link = link;

  RunSummary run;
  run.dataset = "castle \"parallel\"";
  run.mode = "collaborative";
  run.exchange = "compact";
  run.init = "static";
  run.real_time_factor = 1.7;
  run.agents["uav0"] = agent;
  run.agents["uav1"] = AgentSummary();
  run.agents["uav2"].incomplete = "ended by signal 9";
  return run;
}

TEST(RunSummary, HoldsTheKeysOfTheContract) {
  const json summary = to_json(example());
  EXPECT_EQ(summary.at("schema"), 1);
  EXPECT_EQ(summary.at("exchange"), "compact");
  const json& agent = summary.at("agents").at("uav0");
  EXPECT_EQ(agent.at("frames"), 270);
  EXPECT_EQ(agent.at("ate_m").at("none").at("rmse"), 0.4);
  EXPECT_EQ(agent.at("ate_m").at("sim3").at("scale"), 1.002);
  EXPECT_FALSE(agent.at("ate_m").at("se3").contains("scale"));
  EXPECT_EQ(agent.at("rotation_rmse_deg").at("posyaw"), 0.5);
  EXPECT_EQ(agent.at("nees").at("orientation"), 3.1);
  EXPECT_EQ(agent.at("stage_ms").at("track"), 3.5);
  EXPECT_TRUE(agent.at("stage_ms").at("thermal").is_null());
  EXPECT_EQ(agent.at("stage_ms").size(), 9u);
  EXPECT_EQ(agent.at("tracks").at("mean_length"), 14.5);
  EXPECT_EQ(agent.at("link").at("request").at("payload_bytes_sent"), 18432);
  EXPECT_EQ(agent.at("link").at("message").at("gated"), 4);
  EXPECT_TRUE(agent.at("link").at("wire_bytes_received").is_null());
}

TEST(RunSummary, WhatDoesNotApplyIsNull) {
  const json agent = to_json(example()).at("agents").at("uav1");
  for (const char* key : {"initialised_after_s", "distance_m", "ate_m", "rotation_rmse_deg", "nees",
                          "cpu_ms_per_frame", "max_rss_mib", "max_cpu_percent", "link"}) {
    EXPECT_TRUE(agent.at(key).is_null()) << key;
  }
}

TEST(RunSummary, WhatIsWrittenIsReadBack) {
  const TemporaryFolder folder;
  const auto file = folder.path() / "summary.json";
  write_run_summary(file, example());
  EXPECT_EQ(to_json(read_run_summary(file)), to_json(example()));
  // Written beside and renamed: nothing else is left.
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(folder.path()), {}), 1);
}

TEST(RunSummary, SaysWhyAFlightEndedEarlyAndOnlyThen) {
  const json agents = to_json(example()).at("agents");
  EXPECT_EQ(agents.at("uav2").at("incomplete"), "ended by signal 9");
  EXPECT_FALSE(agents.at("uav0").contains("incomplete"));
}

TEST(RunSummary, SaysWhyADroneHasNotStartedAndOnlyThen) {
  RunSummary run = example();
  EXPECT_FALSE(to_json(run).at("agents").at("uav0").contains("not_started"));
  run.agents["uav1"].not_started = "rotating";
  EXPECT_EQ(run_summary_from_json(to_json(run), "run").agents.at("uav1").not_started, "rotating");
}

TEST(RunSummary, SaysWhyALinkWasStartedAnewAndOnlyThen) {
  RunSummary run = example();
  EXPECT_FALSE(to_json(run).at("agents").at("uav0").at("link").contains("restarts"));
  run.agents["uav0"].link->restarts = {{"did not report", 2}, {"ended by itself", 1}};
  const RunSummary read = run_summary_from_json(to_json(run), "run");
  EXPECT_EQ(read.agents.at("uav0").link->restarts, run.agents["uav0"].link->restarts);
  EXPECT_EQ(restart_count(*read.agents.at("uav0").link), 3);
}

TEST(RunSummary, SaysHowFarPeersClocksAreOffWhereThatIsKnown) {
  RunSummary run = example();
  EXPECT_FALSE(to_json(run).at("agents").at("uav0").at("link").contains("clocks"));
  run.agents["uav0"].link->clocks = {{"uav1", {-3000.5, 0.4}}};
  json written = to_json(run);
  const RunSummary read = run_summary_from_json(written, "run");
  EXPECT_EQ(read.agents.at("uav0").link->clocks.at("uav1").clock_offset_ms, -3000.5);
  EXPECT_EQ(read.agents.at("uav0").link->clocks.at("uav1").round_trip_ms, 0.4);
  written["agents"]["uav0"]["link"]["clocks"]["uav1"]["round_trip_ms"] = "short";
  EXPECT_THAT([&] { (void)run_summary_from_json(written, "run"); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("clocks.uav1"), HasSubstr("'round_trip_ms'"))));
}

TEST(RunSummary, AFolderThatDoesNotExistIsNamed) {
  const TemporaryFolder folder;
  EXPECT_THAT([&] { write_run_summary(folder.path() / "none" / "summary.json", example()); },
              ThrowsMessage<std::runtime_error>(HasSubstr("summary.json: cannot be written")));
}

void expect_refused(const json& summary, const std::string& where, const std::string& what) {
  EXPECT_THAT([&] { (void)run_summary_from_json(summary, "summary.json"); },
              ThrowsMessage<std::runtime_error>(AllOf(HasSubstr(where), HasSubstr(what))));
}

TEST(RunSummary, MissingKeysAndWrongTypesAreNamed) {
  json summary = to_json(example());
  summary["schema"] = 2;
  expect_refused(summary, "summary.json", "schema 2");
  summary = to_json(example());
  summary["agents"]["uav0"].erase("frames");
  expect_refused(summary, "agents.uav0", "'frames' is missing");
  summary = to_json(example());
  summary["agents"]["uav0"]["link"]["message"]["fused"] = "many";
  expect_refused(summary, "agents.uav0.link.message", "'fused' is of the wrong type");
  summary = to_json(example());
  summary["agents"]["uav0"]["ate_m"]["se3"] = 5;
  expect_refused(summary, "agents.uav0.ate_m.se3", "is not an object");
}

TEST(RunSummary, AFileThatIsNotJsonIsNamed) {
  const TemporaryFolder folder;
  const auto file = folder.write("summary.json", "{\"schema\": 1,");
  EXPECT_THAT([&] { (void)read_run_summary(file); },
              ThrowsMessage<std::runtime_error>(HasSubstr("summary.json: not valid JSON")));
}

// What a drone tells that was to find its camera as wrong as this.
json agent_summary() {
  json camera = {{"time_offset_s", 0.003},
                 {"time_offset_sigma_s", 0.0001},
                 {"p_imu_cam_m", {0.1, 0.2, 0.3}},
                 {"p_imu_cam_sigma_m", {0.01, 0.02, 0.03}},
                 {"q_imu_cam_xyzw", {0.0, 0.0, std::sin(0.001), std::cos(0.001)}},
                 {"q_imu_cam_sigma_deg", {0.1, 0.2, 0.3}},
                 {"intrinsics_px", {500.0, 510.0, 320.0, 240.0}},
                 {"intrinsics_sigma_px", {1.0, 2.0, 3.0, 4.0}},
                 {"distortion", {-0.3, 0.1, 0.01, 0.02}},
                 {"k1_k2_sigma", {0.001, 0.002}}};
  json at_start = camera;
  at_start["time_offset_s"] = 0.001;
  at_start["p_imu_cam_m"] = {0.1, 0.1, 0.4};
  at_start["q_imu_cam_xyzw"] = {0, 0, 0, -1};  // the same rotation as 1
  at_start["intrinsics_px"] = {501.0, 508.0, 323.0, 236.0};
  at_start["distortion"] = {-0.31, 0.12, 0.0, 0.0};
  at_start["intrinsics_sigma_px"] = {5.0, 6.0, 7.0, 8.0};
  camera["at_start"] = at_start;
  return {{"camera", camera}};
}

std::optional<CameraChanges> camera_changes_in(const json& agent_summary) {
  const TemporaryFolder folder;
  return read_camera_changes(folder.write("agent_summary.json", agent_summary.dump()));
}

TEST(CameraChanges, AreWhatWasFoundMinusWhatWasBelievedAtTheStart) {
  const auto changes = camera_changes_in(agent_summary());
  ASSERT_TRUE(changes.has_value());
  EXPECT_NEAR(changes->time_offset_s.difference[0], 0.002, 1e-12);
  EXPECT_EQ(changes->time_offset_s.sigma[0], 0.0001);
  EXPECT_TRUE(
      changes->rotation_deg.difference.isApprox(Eigen::Vector3d(0, 0, 0.002 * 180 / M_PI), 1e-9));
  EXPECT_EQ(changes->rotation_deg.sigma, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_TRUE(changes->p_imu_cam_m.difference.isApprox(Eigen::Vector3d(0, 0.1, -0.1), 1e-9));
  EXPECT_EQ(changes->focal_lengths_px.difference, Eigen::Vector2d(-1, 2));
  EXPECT_EQ(changes->principal_point_px.difference, Eigen::Vector2d(-3, 4));
  EXPECT_EQ(changes->principal_point_px.sigma, Eigen::Vector2d(3, 4));
  EXPECT_EQ(changes->principal_point_px.sigma_at_start, Eigen::Vector2d(7, 8));
  EXPECT_NEAR(changes->k1.difference[0], 0.01, 1e-12);
  EXPECT_NEAR(changes->k2.difference[0], -0.02, 1e-12);
  EXPECT_EQ(changes->k2.sigma[0], 0.002);
}

TEST(CameraChanges, AreNotKnownOfEarlierVersions) {
  json summary = agent_summary();
  summary["camera"].erase("at_start");
  EXPECT_FALSE(camera_changes_in(summary).has_value());
  summary.erase("camera");
  EXPECT_FALSE(camera_changes_in(summary).has_value());
}

TEST(CameraChanges, WhatIsNoCameraIsNamed) {
  const auto expect_refused_camera = [](const char* patch, const std::string& what) {
    json summary = agent_summary();
    summary.merge_patch(json::parse(patch));
    EXPECT_THAT([&] { (void)camera_changes_in(summary); },
                ThrowsMessage<std::runtime_error>(
                    AllOf(HasSubstr("agent_summary.json: camera"), HasSubstr(what))));
  };
  expect_refused_camera(R"({"camera": 5})", "camera is not an object");
  expect_refused_camera(R"({"camera": {"at_start": []}})", "camera.at_start is not an object");
  expect_refused_camera(R"({"camera": {"k1_k2_sigma": null}})", "'k1_k2_sigma' is missing");
  expect_refused_camera(R"({"camera": {"time_offset_s": "0.003"}})",
                        "'time_offset_s' is of the wrong type");
  expect_refused_camera(R"({"camera": {"at_start": {"p_imu_cam_m": [0.1, null, 0.3]}}})",
                        "camera.at_start the value of 'p_imu_cam_m' is of the wrong type");
  expect_refused_camera(R"({"camera": {"intrinsics_px": [500, 510, 320]}})",
                        "'intrinsics_px' has 3 numbers, not 4");
  expect_refused_camera(R"({"camera": {"q_imu_cam_xyzw": [0, 0, 0, 0]}})",
                        "'q_imu_cam_xyzw' is no unit quaternion");
}

TEST(RunSummary, StagesThatNeverRanHaveNoMean) {
  TimingRecord first;
  first.track_ms = 2;
  TimingRecord second;
  second.track_ms = 4;
  const StageSummary stages = summarize_stages({first, second});
  EXPECT_EQ(stages.track, 3);
  EXPECT_FALSE(stages.thermal.has_value());
  EXPECT_FALSE(summarize_stages({}).track.has_value());
}

TEST(RunSummary, AccuracyFollowsFromEstimateTruthAndCovariances) {
  StampedPoses truth;
  StampedPoses estimate;
  std::vector<StampedCovariance> covariances;
  for (TimeNs i = 0; i < 20; ++i) {
    const double x = static_cast<double>(i);
    const Eigen::Vector3d p(x, x * x, -x);
    truth.push_back({i * 100000000, {p, Eigen::Quaterniond::Identity()}});
    estimate.push_back(
        {i * 100000000, {p + Eigen::Vector3d(0, 0, 2), Eigen::Quaterniond::Identity()}});
    covariances.push_back({i * 100000000, Matrix6d::Identity()});
  }
  const AccuracySummary accuracy = summarize_accuracy(estimate, truth, covariances);
  EXPECT_NEAR(accuracy.none.rmse, 2, 1e-12);
  EXPECT_NEAR(accuracy.posyaw.rmse, 0, 1e-9);
  EXPECT_NEAR(accuracy.sim3.scale.value(), 1, 1e-9);
  EXPECT_NEAR(accuracy.nees_position.value(), 4, 1e-12);
  EXPECT_NEAR(accuracy.nees_orientation.value(), 0, 1e-12);
}

}  // namespace
}  // namespace covey
