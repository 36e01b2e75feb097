// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate_command.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "apps/dataset.h"
#include "apps/png_file.h"
#include "apps/thermal_truth_file.h"
#include "tests/apps/command_run.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string simulate(const std::string& arguments) { return complaint_of("simulate " + arguments); }

std::string bytes(const fs::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

std::size_t entries(const fs::path& folder) {
  return static_cast<std::size_t>(
      std::distance(fs::directory_iterator(folder), fs::directory_iterator()));
}

std::string truth_csv(int rows, const std::string& spoiled_row = "") {
  std::string csv = "#timestamp,px,py,pz,qw,qx,qy,qz,vx,vy,vz,bgx,bgy,bgz,bax,bay,baz\n";
  for (int i = 0; i < rows; ++i)
    csv += std::to_string(1000000000LL + i * 50000000LL) + "," + std::to_string(0.01 * i) +
           ",0,1,0.7071068,0,-0.7071068,0,0.2,0,0,0.01,0.02,0.03,0.1,0.2,0.3\n";
  return csv + spoiled_row;
}

std::string camera_yaml(const std::string& model, const std::string& focal_px,
                        const std::string& distortion) {
  return "comment: a lens of one's own\n"
         "T_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
         "resolution: [200, 120]\ncamera_model: pinhole\n"
         "intrinsics: [" +
         focal_px + ", " + focal_px + ", 99.5, 59.5]\ndistortion_model: " + model +
         "\ndistortion_coefficients: [" + distortion + "]\nline_delay: 5e-5\n";
}

TEST(SimulateCommand, WhatIsNoNumberIsNoLength) {
  EXPECT_THAT(simulate("mars_yard --seconds nan --out nowhere"),
              HasSubstr("--seconds: Value nan not in range 1 to 3600"));
}

TEST(SimulateCommand, WritesWhatTheDatasetReaderReads) {
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "yard";
  ASSERT_EQ(simulate("mars_yard --agents 1 --seconds 1 --rate 2 --raw16 --out " + out.string()),
            "");
  const auto drones = find_drones(out);
  ASSERT_EQ(drones.size(), 1u);
  const Dataset dataset = read_dataset(drones[0].mav0);
  EXPECT_EQ(dataset.images.size(), 2u);
  EXPECT_EQ(dataset.imu.size(), 201u);
  ASSERT_TRUE(dataset.ground_truth.has_value());
  EXPECT_FALSE(dataset.ground_truth->states[0].gyro_bias.isZero());
  EXPECT_EQ(dataset.camera.model, DistortionModel::kEquidistant);
  EXPECT_TRUE(dataset.warnings.empty());
  const cv::Mat grey = read_image(dataset.images[0], 640, 512);
  EXPECT_EQ(grey.type(), CV_8UC1);
  const fs::path name = dataset.images[0].path.filename();
  const cv::Mat raw = read_png((drones[0].mav0 / "cam0raw16" / "data" / name).string());
  EXPECT_EQ(raw.type(), CV_16UC1);
  const auto truth = read_thermal_truth(drones[0].mav0);
  ASSERT_TRUE(truth.has_value());
  ASSERT_EQ(truth->size(), 2u);
  EXPECT_EQ(truth->front().stamp_ns, dataset.images.front().stamp_ns);
  EXPECT_GE(truth->front().white_k - truth->front().black_k, 2.8);
  const cv::Mat field = read_true_field(truth->front().field);
  EXPECT_EQ(field.size(), cv::Size(40, 32));
  EXPECT_EQ(entries(folder.path()), 1u) << "no partial folder is left";

  EXPECT_THAT(simulate("mars_yard --out " + out.string()), HasSubstr("exists already"));
}

TEST(SimulateCommand, ForceReplacesWhatWasSimulatedAndNothingElse) {
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "set";
  const std::string arguments =
      "mars_yard --agents 1 --seconds 1 --rate 1 --raw16 --force --out " + out.string();
  EXPECT_EQ(simulate(arguments), "");
  EXPECT_EQ(simulate(arguments), "") << "all that was simulated may go";
  const fs::path mine = folder.write("set/uav0/mav0/cam0/mine.txt", "precious");
  EXPECT_THAT(simulate(arguments), HasSubstr("only what this command has written"));
  EXPECT_EQ(bytes(mine), "precious");
}

TEST(SimulateCommand, SameSeedWritesTheSameBytesHoweverThreadsTakeTurns) {
  const TemporaryFolder folder;
  const fs::path once = folder.path() / "once", again = folder.path() / "again";
  const std::string shared = "castle_parallel --seconds 1 --rate 1 --out ";
  ASSERT_EQ(simulate(shared + once.string()), "");
  ASSERT_EQ(simulate(shared + again.string()), "");
  int compared = 0;
  for (const auto& entry : fs::recursive_directory_iterator(once)) {
    if (!entry.is_regular_file()) continue;
    const fs::path other = again / fs::relative(entry.path(), once);
    EXPECT_EQ(bytes(entry.path()), bytes(other)) << other;
    ++compared;
  }
  EXPECT_EQ(compared, 3 * 6);  // images, their list, two calibrations, IMU and truth
}

TEST(SimulateCommand, ImagesOfTheWayBackAreThoseOfTheWayThere) {
  const TemporaryFolder folder;
  const fs::path out = folder.path() / "castle";
  ASSERT_EQ(
      simulate("castle_parallel --agents 1 --seconds 2 --rate 2 --legs 3 --out " + out.string()),
      "");
  const Dataset dataset = read_dataset(find_drones(out)[0].mav0);
  EXPECT_EQ(dataset.imu.size(), 1201u);
  ASSERT_EQ(dataset.images.size(), 12u);
  const auto pixels = [&](std::size_t i) { return bytes(dataset.images[i].path); };
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(pixels(i), pixels(7 - i)) << i;
    EXPECT_EQ(pixels(i), pixels(8 + i)) << i;
  }
  EXPECT_NE(pixels(0), pixels(3));
  EXPECT_EQ(dataset.images[4].stamp_ns - dataset.images[3].stamp_ns, 500000000);
}

TEST(SimulateCommand, TheWayBackIsNotForCamerasWhoseImagesWouldDiffer) {
  const TemporaryFolder folder;
  const std::string refused = " --legs 2 --out " + (folder.path() / "refused").string();
  EXPECT_THAT(simulate("castle_parallel --seconds 2 --rate 1.3" + refused), HasSubstr("whole"));
  EXPECT_THAT(simulate("mars_yard" + refused), HasSubstr("thermal"));
  const fs::path rolling =
      folder.write("rolling.yaml", camera_yaml("equidistant", "60", "0, 0, 0, 0"));
  EXPECT_THAT(
      simulate("castle_parallel --seconds 2 --rate 2 --camera " + rolling.string() + refused),
      HasSubstr("--legs is not for rolling shutters"));
  EXPECT_EQ(entries(folder.path()), 1u) << "only the camera";
}

TEST(SimulateCommand, KeepsARecordedImuAndItsStamps) {
  const TemporaryFolder folder;
  std::string imu = "#timestamp,wx,wy,wz,ax,ay,az\n";
  for (int i = -3; i < 500; ++i)
    imu += std::to_string(1000000000LL + i * 5000000LL) + ",0.1,0.2,0.3,9.81,0," +
           std::to_string(0.001 * i) + "\n";
  const fs::path truth_file = folder.write("truth.csv", truth_csv(41));
  const fs::path imu_file = folder.write("imu.csv", imu);
  const fs::path out = folder.path() / "room";
  ASSERT_EQ(simulate("room --seconds 1.5 --rate 2 --trajectory " + truth_file.string() + " --imu " +
                     imu_file.string() + " --out " + out.string()),
            "");
  const Dataset dataset = read_dataset(find_drones(out)[0].mav0);
  ASSERT_EQ(dataset.imu.size(), 301u) << "from the first true state, for 1.5 s";
  EXPECT_EQ(dataset.imu.front().stamp_ns, 1000000000LL);
  EXPECT_EQ(dataset.imu[7].accel_imu, Eigen::Vector3d(9.81, 0, 0.007));
  const TrueState& state = dataset.ground_truth->states[100];
  EXPECT_NEAR(state.pose.p_world_imu.x(), 0.1, 1e-3);
  EXPECT_EQ(state.accel_bias, Eigen::Vector3d(0.1, 0.2, 0.3));
}

TEST(SimulateCommand, BeginsWithinARecording) {
  const TemporaryFolder folder;
  std::string imu = "#timestamp,wx,wy,wz,ax,ay,az\n";
  for (int i = 0; i < 500; ++i)
    imu += std::to_string(1000000000LL + i * 5000000LL) + ",0,0,0,0,0,9.81\n";
  const std::string truth = folder.write("truth.csv", truth_csv(41)).string();
  const std::string imu_file = folder.write("imu.csv", imu).string();
  const fs::path out = folder.path() / "room";
  ASSERT_EQ(simulate("room --seconds 1 --rate 2 --trajectory " + truth + " " + truth + " --imu " +
                     imu_file + " " + imu_file + " --begin 0 0.5 --out " + out.string()),
            "");
  const std::vector<DroneFolder> drones = find_drones(out);
  ASSERT_EQ(drones.size(), 2u);
  const Dataset first = read_dataset(drones[0].mav0), second = read_dataset(drones[1].mav0);
  EXPECT_EQ(first.imu.front().stamp_ns, 1000000000LL);
  EXPECT_EQ(second.imu.front().stamp_ns, 1500000000LL);
  EXPECT_EQ(first.imu.size(), second.imu.size());
}

TEST(SimulateCommand, ARecordingThatEndsBeforeTheFirstImageIsNamed) {
  const TemporaryFolder folder;
  const fs::path truth = folder.write("short.csv", truth_csv(8));  // 0.35 s
  const std::string arguments =
      "room --trajectory " + truth.string() + " --out " + (folder.path() / "room").string();
  EXPECT_THAT(simulate(arguments + " --rate 1 --seed 2"),  // the first comes after 0.35 s
              HasSubstr("short.csv: ends before the first image, of which there are 1 per second"));
  EXPECT_EQ(entries(folder.path()), 1u) << "only the recording";
  EXPECT_EQ(simulate(arguments + " --rate 5"), "");
}

TEST(SimulateCommand, BadRecordingsAreNamedByFileAndLineAndLeaveNothing) {
  const TemporaryFolder folder;
  const fs::path spoiled = folder.write("spoiled.csv", truth_csv(20, "3000000000,1,2,three\n"));
  const fs::path out = folder.path() / "room";
  const std::string to = " --out " + out.string();
  EXPECT_THAT(simulate("room --trajectory " + spoiled.string() + to), HasSubstr("spoiled.csv:22"));
  EXPECT_THAT(simulate("room --trajectory nowhere.csv" + to), HasSubstr("nowhere.csv"));
  const fs::path good = folder.write("good.csv", truth_csv(20));
  const fs::path late = folder.write("late.csv",
                                     "#t,w,w,w,a,a,a\n9000000000,0,0,0,0,0,9.8\n"
                                     "9005000000,0,0,0,0,0,9.8\n");
  EXPECT_THAT(simulate("room --trajectory " + good.string() + " --imu " + late.string() + to),
              HasSubstr("does not overlap"));
  EXPECT_THAT(simulate("castle_around --trajectory " + good.string() + to), HasSubstr("room"));
  EXPECT_THAT(simulate("room --imu " + late.string() + to), HasSubstr("--trajectory"));
  EXPECT_THAT(simulate("room --begin 3" + to), HasSubstr("--begin needs one for each"));
  EXPECT_THAT(simulate("room --trajectory " + good.string() + " --begin 1" + to),
              HasSubstr("good.csv: lasts 0.95 s and cannot begin at 1 s"));
  EXPECT_THAT(simulate("room --raw16" + to), HasSubstr("mars_yard"));
  EXPECT_THAT(simulate("castle_parallel --shutter" + to), HasSubstr("--shutter is for thermal"));
  EXPECT_EQ(entries(folder.path()), 3u) << "only the csv files of this test";
}

const char* const kImuYaml =
    "T_BS:\n  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n"
    "gyroscope_noise_density: 1.0e-3\ngyroscope_random_walk: 5.0e-5\n"
    "accelerometer_noise_density: 1.5e-2\naccelerometer_random_walk: 1.0e-3\n";

TEST(SimulateCommand, FliesOnesOwnCameraAndImu) {
  const TemporaryFolder folder;
  const fs::path camera =
      folder.write("camera.yaml", camera_yaml("equidistant", "60", "-0.01, 0.002, 0, 0"));
  const fs::path imu = folder.write("imu.yaml", kImuYaml);
  const fs::path out = folder.path() / "castle";
  ASSERT_EQ(simulate("castle_parallel --agents 1 --seconds 1 --rate 2 --imu-rate 100 --camera " +
                     camera.string() + " --imu-noise " + imu.string() + " --out " + out.string()),
            "");
  const DroneFolder drone = find_drones(out).at(0);
  const Dataset dataset = read_dataset(drone.mav0);
  EXPECT_EQ(dataset.camera.width, 200);
  EXPECT_EQ(dataset.camera.model, DistortionModel::kEquidistant);
  EXPECT_EQ(dataset.camera.distortion[0], -0.01);
  EXPECT_EQ(dataset.line_delay_s, 5e-5);
  EXPECT_FALSE(dataset.extrinsics.p_imu_cam.isZero()) << "mounted as the scenario's";
  EXPECT_EQ(dataset.imu_noise.gyro_density, 1e-3);
  EXPECT_EQ(dataset.imu.size(), 101u);
  EXPECT_THAT(bytes(drone.mav0 / "imu0" / "sensor.yaml"), HasSubstr("rate_hz: 100"));
  // 95 degrees to each side at the ends of a row: dark; the middle is not.
  const cv::Mat image = read_image(dataset.images.at(0), 200, 120);
  const auto middle_row = [&](int from_x) {
    return cv::mean(image(cv::Rect(from_x, 50, 10, 20)))[0];
  };
  EXPECT_LT(middle_row(0), 5);
  EXPECT_GT(middle_row(95), 20);
}

TEST(SimulateCommand, CamerasAndImusThatCannotBeAreNamedAndLeaveNothing) {
  const TemporaryFolder folder;
  const std::string to = " --out " + (folder.path() / "out").string();
  const fs::path odd = folder.write("odd.yaml", camera_yaml("fov", "60", "0, 0, 0, 0"));
  EXPECT_THAT(simulate("room --camera " + odd.string() + to), HasSubstr("odd.yaml:7: unknown"));
  const fs::path wide = folder.write("wide.yaml", camera_yaml("equidistant", "60", "0, 0, 0, 0"));
  EXPECT_THAT(simulate("mars_yard --camera " + wide.string() + to),
              HasSubstr("does not reach pixel (0, 0)"));
  const fs::path truth = folder.write("truth.csv", truth_csv(41));
  EXPECT_THAT(simulate("room --imu-rate 100 --trajectory " + truth.string() + " --imu " +
                       truth.string() + to),
              HasSubstr("--imu-rate are for simulated IMUs"));
  EXPECT_THAT(simulate("room --imu-noise nowhere.yaml" + to), HasSubstr("nowhere.yaml"));
  EXPECT_EQ(entries(folder.path()), 3u) << "only the files of this test";
}

TEST(SimulateCommand, UnknownScenariosAndRatesAreBadUsage) {
  EXPECT_THAT(simulate("moon --out x"), HasSubstr("moon"));
  EXPECT_THAT(simulate("room --rate 0 --out x"), HasSubstr("0"));
  EXPECT_THAT(simulate("room"), HasSubstr("--out"));
}

}  // namespace
}  // namespace covey
