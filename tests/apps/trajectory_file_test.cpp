// SPDX-License-Identifier: Apache-2.0
#include "apps/trajectory_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <stdexcept>

#include "apps/run_files.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::ThrowsMessage;

class TrajectoryFile : public testing::Test {
 protected:
  StampedPoses read(const std::string& content) const {
    return read_trajectory(folder_.write("trajectory.txt", content));
  }
  void expect_refused(const std::string& content, const std::string& one,
                      const std::string& other) const {
    EXPECT_THAT([&] { (void)read(content); },
                ThrowsMessage<std::runtime_error>(AllOf(HasSubstr(one), HasSubstr(other))));
  }

  TemporaryFolder folder_;
};

TEST_F(TrajectoryFile, TumAndEurocAreToldApartByContent) {
  const StampedPoses tum = read("# t x y z qx qy qz qw\n1.5 1 2 3 0 0 1 0\n");
  const StampedPoses euroc = read("#timestamp,x\n1500000000,1,2,3,0,0,0,1,9,9,9\n");
  for (const StampedPoses& trajectory : {tum, euroc}) {
    ASSERT_EQ(trajectory.size(), 1u);
    EXPECT_EQ(trajectory[0].stamp_ns, 1500000000);
    EXPECT_EQ(trajectory[0].pose.p_world_imu, Eigen::Vector3d(1, 2, 3));
    EXPECT_EQ(trajectory[0].pose.q_world_imu.z(), 1);
    EXPECT_EQ(trajectory[0].pose.q_world_imu.w(), 0);
  }
}

TEST_F(TrajectoryFile, SecondsKeepTheirNanoseconds) {
  const StampedPoses trajectory = read(
      "1403636579.763555527 0 0 0 0 0 0 1\n"
      "1.403636579813555479e+09 0 0 0 0 0 0 1\n");
  EXPECT_EQ(trajectory[0].stamp_ns, 1403636579763555527);
  EXPECT_EQ(trajectory[1].stamp_ns, 1403636579813555479);
}

TEST_F(TrajectoryFile, CommentsBlankLinesTabsAndWindowsEndsAreNoMistake) {
  EXPECT_EQ(read("# a\n\n1\t0 0  0 0 0 0 1\r\n#b\n 2 0 0 0 0 0 0 1 \n\n").size(), 2u);
}

TEST_F(TrajectoryFile, WhatIsWrittenIsReadBack) {
  StampedPoses written;
  written.push_back({1403636579763555527, {{1.25, -2.5, 3}, {0.5, 0.5, -0.5, 0.5}}});
  written.push_back({1403636579800000001, {{0, 0, 0}, {1, 0, 0, 0}}});
  write_tum(folder_.path() / "out.tum", written);
  const StampedPoses read = read_trajectory(folder_.path() / "out.tum");
  ASSERT_EQ(read.size(), 2u);
  EXPECT_EQ(read[0].stamp_ns, written[0].stamp_ns);
  EXPECT_EQ(read[1].stamp_ns, written[1].stamp_ns);
  EXPECT_EQ(read[0].pose.p_world_imu, written[0].pose.p_world_imu);
  EXPECT_EQ(read[0].pose.q_world_imu.coeffs(), written[0].pose.q_world_imu.coeffs());
}

TEST_F(TrajectoryFile, CovariancesAreReadBackSymmetric) {
  StampedCovariance sample;
  sample.stamp_ns = 1403636579763555527;
  for (int row = 0; row < 6; ++row) {
    for (int col = 0; col < 6; ++col)
      sample.covariance(row, col) = row * col + (row == col ? 1 : 0);
  }
  const auto read = read_covariances(
      folder_.write("covariance.csv", kCovarianceHeader + ("\n" + covariance_line(sample)) + "\n"));
  ASSERT_EQ(read.size(), 1u);
  EXPECT_EQ(read[0].stamp_ns, sample.stamp_ns);
  EXPECT_EQ(read[0].covariance, sample.covariance);
}

TEST_F(TrajectoryFile, BadFilesAreRefusedWithFileAndLine) {
  const std::string good = "# t x y z qx qy qz qw\n1 0 0 0 0 0 0 1\n";
  expect_refused("", "trajectory.txt", "holds no pose");
  expect_refused(good + "2 0 0 0 0 0\n", "trajectory.txt:3: ", "6 columns, expected 8");
  expect_refused(good + "2 0 0 x 0 0 0 1\n", "trajectory.txt:3: ", "not a number: 'x'");
  expect_refused(good + "2 0 0 nan 0 0 0 1\n", "trajectory.txt:3: ", "not finite");
  expect_refused(good + "2 0 0 0 0 0 0 0\n", "trajectory.txt:3: ", "quaternion");
  expect_refused(good + "1 0 0 0 0 0 0 1\n", "trajectory.txt:3: ", "appears twice");
  expect_refused(good + "0.5 0 0 0 0 0 0 1\n", "trajectory.txt:3: ", "sort the lines");
  expect_refused(good + "nan 0 0 0 0 0 0 1\n", "trajectory.txt:3: ", "not a time in seconds");
  expect_refused(good + "-1 0 0 0 0 0 0 1\n", "trajectory.txt:3: ", "not a time in seconds");
  expect_refused(good + "1e30 0 0 0 0 0 0 1\n", "trajectory.txt:3: ", "not a time in seconds");
  expect_refused("1.5,0,0,0,1,0,0,0\n", "trajectory.txt:1: ", "whole number of nanoseconds");
}

TEST_F(TrajectoryFile, AMissingFileIsNamed) {
  EXPECT_THAT([this] { (void)read_trajectory(folder_.path() / "none.tum"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("none.tum: cannot be read")));
  EXPECT_THAT([this] { (void)read_trajectory(folder_.path()); },
              ThrowsMessage<std::runtime_error>(HasSubstr("cannot be read")));
}

// ------------------------------------------------------------------------------------- run files

TEST_F(TrajectoryFile, AFolderThatDoesNotExistIsNamedWhenWriting) {
  EXPECT_THAT([this] { write_tum(folder_.path() / "none" / "out.tum", {}); },
              ThrowsMessage<std::runtime_error>(HasSubstr("out.tum: cannot be written")));
}

TEST_F(TrajectoryFile, OdometryIsWrittenAsTrajectoryAndCovariance) {
  Odometry odometry;
  odometry.stamp_ns = 5000000000;
  odometry.pose.p_world_imu = {1, 2, 3};
  odometry.pose_covariance.diagonal() << 1, 2, 3, 4, 5, 6;
  OdometryWriter writer(folder_.path());
  writer.write(odometry);
  const StampedPoses trajectory = read_trajectory(folder_.path() / kTrajectoryFile);
  const auto covariances = read_covariances(folder_.path() / kCovarianceFile);
  ASSERT_EQ(trajectory.size(), 1u);
  ASSERT_EQ(covariances.size(), 1u);
  EXPECT_EQ(trajectory[0].stamp_ns, covariances[0].stamp_ns);
  EXPECT_EQ(covariances[0].covariance(5, 5), 6);
}

TEST_F(TrajectoryFile, TimingsAndLinkAreReadBack) {
  TimingRecord timing;
  timing.stamp_ns = 1403636579763555527;
  timing.thermal_ms = 1.25;
  timing.total_ms = 7.5;
  timing.tracks = 199;
  timing.slam_gated = 3;
  TimingWriter timing_writer(folder_.path());
  timing_writer.write(timing);
  LinkRecord link;
  link.stamp_ns = 1403636579763555527;
  link.requests_sent = 4;
  link.payload_bytes_sent = 5000000000;
  LinkWriter link_writer(folder_.path());
  link_writer.write(link);

  const auto timings = read_timings(folder_.path() / kTimingsFile);
  ASSERT_EQ(timings.size(), 1u);
  EXPECT_EQ(timings[0].stamp_ns, timing.stamp_ns);
  EXPECT_EQ(timings[0].thermal_ms, 1.25);
  EXPECT_EQ(timings[0].total_ms, 7.5);
  EXPECT_EQ(timings[0].tracks, 199);
  EXPECT_EQ(timings[0].slam_gated, 3);
  const auto links = read_link(folder_.path() / kLinkFile);
  ASSERT_EQ(links.size(), 1u);
  EXPECT_EQ(links[0].requests_sent, 4);
  EXPECT_EQ(links[0].payload_bytes_sent, 5000000000);
}

TEST_F(TrajectoryFile, QuestionsAndAnswersComeBackAsTheyWereWritten) {
  ExchangeWriter writer(folder_.path());
  writer.write({1234.5678, ExchangeEvent::kAsked, kEveryPeer, 7});
  writer.write({1300, ExchangeEvent::kRejected, "uav2", 18446744073});
  const auto file = folder_.path() / kExchangeFile;
  const auto records = read_exchange(file);
  ASSERT_EQ(records.size(), 2u);
  EXPECT_EQ(records[0].clock_ms, 1234.568);
  EXPECT_EQ(records[0].event, ExchangeEvent::kAsked);
  EXPECT_EQ(records[0].peer, kEveryPeer);
  EXPECT_EQ(records[1].event, ExchangeEvent::kRejected);
  EXPECT_EQ(records[1].keyframe_id, 18446744073u);

  folder_.write(kExchangeFile, "clock_ms,event,peer,keyframe_id\n1,shouted,uav0,2\n");
  EXPECT_THAT([&] { (void)read_exchange(file); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("exchange.csv:2: "), HasSubstr("unknown event 'shouted'"))));
}

TEST_F(TrajectoryFile, ATableWithoutAColumnNamesIt) {
  const auto file = folder_.write("link.csv", "stamp_ns,requests_sent\n1,2\n");
  EXPECT_THAT([&] { (void)read_link(file); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("link.csv:1: "), HasSubstr("'requests_received' is missing"))));
  folder_.write("link.csv", "");
  EXPECT_THAT([&] { (void)read_link(file); },
              ThrowsMessage<std::runtime_error>(HasSubstr("header line")));
}

}  // namespace
}  // namespace covey
