// SPDX-License-Identifier: Apache-2.0
#include "sim/dataset_writer.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>

namespace covey {
namespace {

namespace fs = std::filesystem;

class DatasetWriter : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    folder_ = fs::path(::testing::TempDir()) / (std::string("covey_writer_") + test->name());
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }
  void TearDown() override { fs::remove_all(folder_); }

  static std::string content(const fs::path& file) {
    std::stringstream all;
    all << std::ifstream(file).rdbuf();
    return all.str();
  }
  // As far as it tells who has written it.
  void write_simulated(const std::string& camera) const {
    const fs::path mav0 = folder_ / "set" / "uav0" / "mav0";
    CameraDescription description;
    description.comment = camera;
    write_camera_file(mav0 / "cam0" / "sensor.yaml", description);
    ImageList images(mav0 / "cam0");
    std::ofstream(images.add(1)) << "an image";
    images.close();
    write_imu_csv(mav0 / "imu0" / "data.csv", {});
    write_ground_truth_csv(mav0 / "state_groundtruth_estimate0" / "data.csv", {});
  }
  [[nodiscard]] std::size_t entries() const {
    return static_cast<std::size_t>(
        std::distance(fs::directory_iterator(folder_), fs::directory_iterator()));
  }

  fs::path folder_;
};

TEST_F(DatasetWriter, NothingIsThereBeforeTheCommitAndNothingElseAfter) {
  StagedFolder staged(folder_ / "set");
  std::ofstream(staged.path() / "file") << "x";
  EXPECT_FALSE(fs::exists(folder_ / "set"));
  staged.commit();
  EXPECT_TRUE(fs::exists(folder_ / "set" / "file"));
  EXPECT_EQ(entries(), 1u);
}

TEST_F(DatasetWriter, AnAbandonedDatasetLeavesNothingBehind) {
  { const StagedFolder staged(folder_ / "set"); }
  EXPECT_EQ(entries(), 0u);
}

TEST_F(DatasetWriter, AnExistingFolderIsOnlyReplacedWhenAsked) {
  write_simulated("simulated grey camera");
  EXPECT_THROW(StagedFolder(folder_ / "set"), std::runtime_error);
  StagedFolder staged(folder_ / "set", is_simulated);
  EXPECT_TRUE(fs::exists(folder_ / "set" / "uav0")) << "kept until the new one is whole";
  staged.commit();
  EXPECT_FALSE(fs::exists(folder_ / "set" / "uav0"));
}

TEST_F(DatasetWriter, WhatHasComeMeanwhileIsNotReplaced) {
  for (const IsReplaceable is_replaceable : {IsReplaceable(nullptr), IsReplaceable(is_simulated)}) {
    StagedFolder second(folder_ / "set", is_replaceable);
    {
      StagedFolder first(folder_ / "set");
      std::ofstream(first.path() / "file") << "the first";
      first.commit();
    }
    EXPECT_THROW(second.commit(), std::runtime_error);
    EXPECT_EQ(content(folder_ / "set" / "file"), "the first");
    fs::remove_all(folder_ / "set");
  }
}

TEST_F(DatasetWriter, AnEmptyFolderIsTakenForOneThatIsNotThere) {
  fs::create_directories(folder_ / "set");
  StagedFolder staged(folder_ / "set");
  std::ofstream(staged.path() / "file") << "x";
  staged.commit();
  EXPECT_TRUE(fs::exists(folder_ / "set" / "file"));
}

TEST_F(DatasetWriter, WhatIsNoDatasetIsNotReplaced) {
  write_simulated("simulated grey camera");
  std::ofstream(folder_ / "set" / "thesis.txt") << "mine";
  EXPECT_THROW(StagedFolder(folder_ / "set", is_simulated), std::runtime_error);
  EXPECT_THROW(StagedFolder(folder_ / "set" / "thesis.txt", is_simulated), std::runtime_error);
  EXPECT_TRUE(fs::exists(folder_ / "set" / "thesis.txt"));
  fs::create_directories(folder_ / "empty");
  EXPECT_NO_THROW(StagedFolder(folder_ / "empty", is_simulated));
}

TEST_F(DatasetWriter, WhatSomebodyPutIntoADatasetIsNotReplaced) {
  for (const char* const name : {"mine.txt", "uav0/mine.txt", "uav0/mav0/mine.txt",
                                 "uav0/mav0/cam0/mine.txt", "uav0/mav0/cam0/data/mine.txt"}) {
    write_simulated("simulated thermal camera");
    EXPECT_TRUE(is_simulated(folder_ / "set"));
    std::ofstream(folder_ / "set" / name) << "mine";
    EXPECT_FALSE(is_simulated(folder_ / "set")) << name;
    fs::remove_all(folder_ / "set");
  }
}

TEST_F(DatasetWriter, ARecordingIsNotReplaced) {
  write_simulated("VI-Sensor cam0 (MT9M034)");
  EXPECT_FALSE(is_simulated(folder_ / "set"));
  write_simulated("simulated grey camera");
  EXPECT_TRUE(is_simulated(folder_ / "set"));
  fs::remove_all(folder_ / "set/uav0/mav0/state_groundtruth_estimate0");
  EXPECT_FALSE(is_simulated(folder_ / "set")) << "imported with the calibration of a simulation";
}

TEST_F(DatasetWriter, LinksStayAndWhatTheyLeadToIsReplaced) {
  fs::create_directories(folder_ / "disk" / "set");
  fs::create_symlink("disk/set", folder_ / "link");
  StagedFolder staged(folder_ / "link");
  std::ofstream(staged.path() / "file") << "x";
  staged.commit();
  EXPECT_TRUE(fs::is_symlink(folder_ / "link"));
  EXPECT_EQ(content(folder_ / "disk" / "set" / "file"), "x");
  fs::create_symlink("nowhere", folder_ / "broken");
  EXPECT_THROW(StagedFolder(folder_ / "broken"), std::runtime_error);
}

TEST_F(DatasetWriter, AnUnwritablePlaceIsNamed) {
  EXPECT_THROW(StagedFolder(""), std::runtime_error);

  std::ofstream(folder_ / "file") << "x";
  try {
    const StagedFolder staged(folder_ / "file" / "set");
    FAIL() << "a folder below a file cannot be";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("set"), std::string::npos);
  }
}

TEST_F(DatasetWriter, ImuSamplesKeepEveryBit) {
  ImuSample sample;
  sample.stamp_ns = 1403715273262142976;
  sample.gyro_imu = {-0.0020943951023931952, 0.017453292519943295, 1.0 / 3};
  sample.accel_imu = {9.0874956666666655, 1e-17, -3.6938381666666662};
  write_imu_csv(folder_ / "imu.csv", {sample});
  std::ifstream file(folder_ / "imu.csv");
  std::string header, line, field;
  std::getline(file, header);
  std::getline(file, line);
  std::stringstream fields(line);
  std::getline(fields, field, ',');
  EXPECT_EQ(std::stoll(field), sample.stamp_ns);
  for (int axis = 0; axis < 6; ++axis) {
    std::getline(fields, field, ',');
    EXPECT_EQ(std::stod(field), axis < 3 ? sample.gyro_imu[axis] : sample.accel_imu[axis - 3]);
  }
}

TEST_F(DatasetWriter, GroundTruthHasTheSeventeenColumnsOfEuRoC) {
  TrueState state;
  state.stamp_ns = 5;
  state.pose.q_world_imu = Eigen::Quaterniond(0.5, -0.5, 0.5, -0.5);
  write_ground_truth_csv(folder_ / "truth.csv", {state});
  const std::string text = content(folder_ / "truth.csv");
  EXPECT_NE(text.find("\n5,0,0,0,0.5,-0.5,0.5,-0.5,0,0,0,0,0,0,0,0,0\n"), std::string::npos);
}

TEST_F(DatasetWriter, CameraFileNamesModelAndMounting) {
  CameraDescription camera;
  camera.intrinsics = {
      640, 512, 390, 391, 319.5, 255.5, DistortionModel::kEquidistant, {0.1, 0.2, 0.3, 0.4}};
  camera.extrinsics.p_imu_cam = {0.25, 0.5, 0.75};
  write_camera_file(folder_ / "cam0" / "sensor.yaml", camera);
  const std::string text = content(folder_ / "cam0" / "sensor.yaml");
  EXPECT_NE(text.find("distortion_model: equidistant"), std::string::npos);
  EXPECT_NE(text.find("resolution: [640, 512]"), std::string::npos);
  EXPECT_NE(text.find("intrinsics: [390, 391, 319.5, 255.5]"), std::string::npos);
  EXPECT_NE(text.find("data: [1, 0, 0, 0.25,"), std::string::npos);
}

TEST_F(DatasetWriter, ImageListNamesFilesByTheirStamp) {
  ImageList list(folder_ / "cam0");
  EXPECT_EQ(list.add(123), folder_ / "cam0" / "data" / "123.png");
  (void)list.add(456);
  list.close();
  EXPECT_EQ(content(folder_ / "cam0" / "data.csv"),
            "#timestamp [ns],filename\n123,123.png\n456,456.png\n");
}

}  // namespace
}  // namespace covey
