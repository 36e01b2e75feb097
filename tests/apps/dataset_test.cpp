// SPDX-License-Identifier: Apache-2.0
#include "apps/dataset.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <stdexcept>

#include "apps/png_file.h"
#include "tests/apps/temporary_folder.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::ThrowsMessage;

constexpr char kCameraYaml[] = R"(%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: [0.0, -1.0, 0.0, 0.1,
         1.0,  0.0, 0.0, 0.2,
         0.0,  0.0, 1.0, 0.3,
         0.0,  0.0, 0.0, 1.0]
rate_hz: 20
resolution: [64, 48]
camera_model: pinhole
intrinsics: [45.5, 45.6, 31.5, 23.5] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]
)";

constexpr char kImuYaml[] = R"(T_BS:
  cols: 4
  rows: 4
  data: [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
gyroscope_noise_density: 1.7e-4
gyroscope_random_walk: 1.9e-5
accelerometer_noise_density: 2.0e-3
accelerometer_random_walk: 3.0e-3
)";

constexpr char kImages[] =
    "#timestamp [ns],filename\n"
    "1000000000,a.png\n"
    "1050000000,b.png\n"
    "1100000000,c.png\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

// 200 Hz from 0.99 s to 1.11 s, at rest.
std::string imu_csv() {
  std::string csv = "#timestamp [ns],wx,wy,wz,ax,ay,az\n";
  for (int i = 0; i <= 24; ++i) {
    csv += std::to_string(990000000 + 5000000 * i) + ",0.01,-0.02,0.03,0.1,-0.2,9.81\n";
  }
  return csv;
}

// A drone with three images, its IMU and its ground truth.
class DatasetTest : public testing::Test {
 protected:
  DatasetTest() {
    write("cam0/sensor.yaml", kCameraYaml);
    write("cam0/data.csv", kImages);
    for (const char* name : {"a.png", "b.png", "c.png"}) {
      write(std::string("cam0/data/") + name, "");
    }
    write("imu0/sensor.yaml", kImuYaml);
    write("imu0/data.csv", imu_csv());
    write("state_groundtruth_estimate0/data.csv",
          "#t,px,py,pz,qw,qx,qy,qz,vx,vy,vz,bwx,bwy,bwz,bax,bay,baz\n"
          "1000000000,1,2,3,1,0,0,0,0.4,0.5,0.6,0.01,0.02,0.03,0.1,0.2,0.3\n"
          "1100000000,2,2,3,0,0,0,1,0.6,0.5,0.6,0.01,0.02,0.03,0.1,0.2,0.3\n");
  }

  fs::path write(const fs::path& name, const std::string& content) const {
    return folder_.write(mav0_name_ / name, content);
  }
  [[nodiscard]] fs::path mav0() const { return folder_.path() / mav0_name_; }

  void expect_refused(const std::string& one, const std::string& other = "") const {
    EXPECT_THAT([this] { (void)read_dataset(mav0()); },
                ThrowsMessage<std::runtime_error>(AllOf(HasSubstr(one), HasSubstr(other))));
  }

  TemporaryFolder folder_;
  fs::path mav0_name_ = fs::path("uav0") / "mav0";
};

TEST_F(DatasetTest, EverythingInAGoodFolderIsRead) {
  const Dataset dataset = read_dataset(mav0());
  EXPECT_EQ(dataset.camera.width, 64);
  EXPECT_EQ(dataset.camera.height, 48);
  EXPECT_EQ(dataset.camera.fy, 45.6);
  EXPECT_EQ(dataset.camera.cx, 31.5);
  EXPECT_EQ(dataset.camera.model, DistortionModel::kRadialTangential);
  EXPECT_EQ(dataset.camera.distortion[0], -0.28);
  // The camera's x axis is the body's y axis.
  EXPECT_TRUE((dataset.extrinsics.q_imu_cam * Eigen::Vector3d::UnitX())
                  .isApprox(Eigen::Vector3d::UnitY(), 1e-12));
  EXPECT_TRUE(dataset.extrinsics.p_imu_cam.isApprox(Eigen::Vector3d(0.1, 0.2, 0.3)));
  EXPECT_EQ(dataset.extrinsics.time_offset_s, 0);
  EXPECT_EQ(dataset.imu_noise.gyro_random_walk, 1.9e-5);
  EXPECT_EQ(dataset.imu_noise.accel_density, 2.0e-3);
  ASSERT_EQ(dataset.images.size(), 3u);
  EXPECT_EQ(dataset.images[1].stamp_ns, 1050000000);
  EXPECT_EQ(dataset.images[1].path, mav0() / "cam0" / "data" / "b.png");
  ASSERT_EQ(dataset.imu.size(), 25u);
  EXPECT_EQ(dataset.imu[0].accel_imu, Eigen::Vector3d(0.1, -0.2, 9.81));
  ASSERT_TRUE(dataset.ground_truth.has_value());
  EXPECT_EQ(dataset.ground_truth->states[0].accel_bias, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_TRUE(dataset.imu_gaps.empty());
  EXPECT_TRUE(dataset.warnings.empty());
}

TEST_F(DatasetTest, StampsKeepEveryNanosecond) {
  write("imu0/data.csv",
        "1403715273262142976,0,0,0,0,0,9.81\n1403715273267142912,0,0,0,0,0,9.81\n");
  EXPECT_EQ(read_imu(mav0() / "imu0" / "data.csv")[0].stamp_ns, 1403715273262142976);
}

TEST_F(DatasetTest, WindowsLineEndsAndBlankLinesAreNoMistake) {
  write("cam0/data.csv",
        "#t,f\r\n1000000000,a.png\r\n\r\n 1050000000 , b.png \r\n1100000000,c.png");
  EXPECT_EQ(read_dataset(mav0()).images.size(), 3u);
}

TEST_F(DatasetTest, WhatASensorFileCanHardlyMeanIsSaidAndFlown) {
  const auto doubts = [&] { return read_dataset(mav0()).warnings; };
  write("cam0/sensor.yaml", replaced(kCameraYaml, "[45.5, 45.6,", "[0.7, 0.7,"));
  EXPECT_THAT(doubts(),
              ElementsAre(HasSubstr("cam0/sensor.yaml: intrinsics: a focal length of 0.7 px")));
  write("cam0/sensor.yaml", replaced(kCameraYaml, "31.5, 23.5]", "315, 235]"));
  EXPECT_THAT(doubts(), ElementsAre(HasSubstr("the principal point (315, 235) lies outside")));
  write("cam0/sensor.yaml", replaced(kCameraYaml, "0.1,", "100,"));
  EXPECT_THAT(doubts(), ElementsAre(AllOf(HasSubstr("100.0 m apart"), HasSubstr("in metres?"))));
  write("cam0/sensor.yaml", std::string(kCameraYaml) + "line_delay: 30\n");
  EXPECT_THAT(doubts(), ElementsAre(AllOf(HasSubstr("1.44e+03 s"), HasSubstr("in seconds?"))));
  write("cam0/sensor.yaml", kCameraYaml);
  write("imu0/sensor.yaml", replaced(replaced(kImuYaml, "1.7e-4", "17"), "2.0e-3", "20"));
  EXPECT_THAT(doubts(), ElementsAre(HasSubstr("imu0/sensor.yaml: gyroscope_noise_density of 17"),
                                    HasSubstr("accelerometer_noise_density of 20")));
}

TEST_F(DatasetTest, SensorFilesNeedNoYamlHeader) {
  write("cam0/sensor.yaml", replaced(kCameraYaml, "%YAML:1.0\n", ""));
  write("imu0/sensor.yaml", std::string("%YAML:1.0\n---\n") + kImuYaml);
  EXPECT_EQ(read_dataset(mav0()).camera.width, 64);
}

TEST_F(DatasetTest, ARollingShutterIsKnownByItsLineDelay) {
  EXPECT_EQ(read_dataset(mav0()).line_delay_s, 0);
  write("cam0/sensor.yaml", std::string(kCameraYaml) + "line_delay: 2.5e-5\n");
  EXPECT_EQ(read_dataset(mav0()).line_delay_s, 2.5e-5);
}

TEST_F(DatasetTest, AThermalCameraIsKnownByWhatTheCommentNames) {
  struct Named {
    const char* comment;
    bool thermal;
  };
  constexpr Named kCameras[] = {
      {"thermal camera", true},
      {"simulated Thermal_cam0, 8 bits", true},
      {"ThermalCamera640", true},
      {"mono thermal", true},
      {"Infrared camera", true},
      {"long-wave infrared", true},
      {"FLIR Boson 640 LWIR", true},
      {"flir_boson", true},
      {"FLIR Tau 2", true},
      {"uncooled microbolometer", true},
      {"cooled MWIR", true},
      {"thermographic", true},
      {"VI-Sensor cam0 (MT9M034)", false},
      {"MT9V034, infrared cut filter", false},
      {"MT9V034, infrared-blocking glass", false},
      {"not thermal", false},
      {"not a thermal camera", false},
      {"non-thermal", false},
      {"FLIR Blackfly S, visual", false},
      {"near-infrared, 850 nm", false},
      {"D435, infrared stereo", false},
      {"infrared LEDs", false},
      {"athermal lens, thermally stabilised", false},
      {"thermal camera, no infrared illumination", true},
  };
  EXPECT_FALSE(read_dataset(mav0()).thermal) << "without a comment";
  for (const Named& camera : kCameras) {
    write("cam0/sensor.yaml", std::string(kCameraYaml) + "comment: \"" + camera.comment + "\"\n");
    EXPECT_EQ(read_dataset(mav0()).thermal, camera.thermal) << camera.comment;
  }
}

TEST_F(DatasetTest, ALineDelayBelowZeroIsRefused) {
  write("cam0/sensor.yaml", std::string(kCameraYaml) + "line_delay: -2.5e-5\n");
  expect_refused("cam0/sensor.yaml:16: ", "line_delay must not be negative");
}

TEST_F(DatasetTest, AKeyThatStandsTwiceIsNamed) {
  write("cam0/sensor.yaml", std::string(kCameraYaml) + "camera_model: pinhole\n");
  expect_refused("cam0/sensor.yaml:16: ", "key 'camera_model' stands twice");
  write("cam0/sensor.yaml", kCameraYaml);
  write("imu0/sensor.yaml", replaced(kImuYaml, "  rows: 4", "  rows: 4\n  rows: 3"));
  expect_refused("imu0/sensor.yaml:4: ", "key 'rows' stands twice");
}

TEST_F(DatasetTest, EquidistantCamerasAndKalibrsTimeShiftAreKnown) {
  write("cam0/sensor.yaml",
        replaced(kCameraYaml, "radial-tangential", "equidistant") + "timeshift_cam_imu: -0.004\n");
  const Dataset dataset = read_dataset(mav0());
  EXPECT_EQ(dataset.camera.model, DistortionModel::kEquidistant);
  EXPECT_EQ(dataset.extrinsics.time_offset_s, -0.004);
}

TEST_F(DatasetTest, GroundTruthIsOptional) {
  fs::remove_all(mav0() / "state_groundtruth_estimate0");
  EXPECT_FALSE(read_dataset(mav0()).ground_truth.has_value());
}

TEST_F(DatasetTest, GroundTruthIsInterpolatedBetweenStates) {
  const GroundTruth truth = *read_dataset(mav0()).ground_truth;
  const std::optional<TrueState> state = ground_truth_at(truth, 1050000000);
  ASSERT_TRUE(state.has_value());
  EXPECT_TRUE(state->pose.p_world_imu.isApprox(Eigen::Vector3d(1.5, 2, 3)));
  EXPECT_NEAR(state->v_world_imu.x(), 0.5, 1e-12);
  // Half of half a turn about z.
  EXPECT_NEAR(state->pose.q_world_imu.angularDistance(
                  Eigen::Quaterniond(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ()))),
              0, 1e-9);
  EXPECT_FALSE(ground_truth_at(truth, 999999999).has_value());
  EXPECT_FALSE(ground_truth_at(truth, 1100000001).has_value());
}

TEST_F(DatasetTest, NothingIsInterpolatedAcrossAHoleOfTheGroundTruth) {
  write("state_groundtruth_estimate0/data.csv",
        "1000000000,1,0,0,1,0,0,0\n1100000000,1.1,0,0,1,0,0,0\n"
        "1700000000,9,0,0,1,0,0,0\n1800000000,9.2,0,0,1,0,0,0\n");
  const GroundTruth truth = *read_dataset(mav0()).ground_truth;
  EXPECT_TRUE(ground_truth_at(truth, 1050000000).has_value());
  EXPECT_TRUE(ground_truth_at(truth, 1100000000).has_value());
  EXPECT_FALSE(ground_truth_at(truth, 1200000000).has_value());
  EXPECT_TRUE(ground_truth_at(truth, 1700000000).has_value());
  EXPECT_NEAR(truth.states[1].v_world_imu.x(), 1, 1e-9) << "from before the hole alone";
  EXPECT_NEAR(truth.states[2].v_world_imu.x(), 2, 1e-9) << "from after it";
  EXPECT_EQ(nearest_state(truth, 0).stamp_ns, 1000000000);
  EXPECT_EQ(nearest_state(truth, 1390000000).stamp_ns, 1100000000);
  EXPECT_EQ(nearest_state(truth, 1410000000).stamp_ns, 1700000000);
  EXPECT_EQ(nearest_state(truth, 2000000000).stamp_ns, 1800000000);
}

TEST_F(DatasetTest, GroundTruthOfPosesOnlyGetsVelocitiesByDifferences) {
  write("state_groundtruth_estimate0/data.csv",
        "1000000000,1,0,0,1,0,0,0\n1050000000,1.1,0,0,1,0,0,0\n1100000000,1.3,0,0,1,0,0,0\n");
  const GroundTruth truth = *read_dataset(mav0()).ground_truth;
  EXPECT_TRUE(truth.states[0].gyro_bias.isZero());
  EXPECT_NEAR(truth.states[0].v_world_imu.x(), 2, 1e-9);
  EXPECT_NEAR(truth.states[1].v_world_imu.x(), 3, 1e-9);
}

TEST_F(DatasetTest, DronesAreFoundInNaturalOrder) {
  fs::create_directories(folder_.path() / "uav10" / "mav0");
  fs::create_directories(folder_.path() / "uav2" / "mav0");
  fs::create_directories(folder_.path() / "notes");
  std::vector<std::string> names;
  for (const DroneFolder& drone : find_drones(folder_.path())) names.push_back(drone.name);
  EXPECT_THAT(names, ElementsAre("uav0", "uav2", "uav10"));
}

TEST_F(DatasetTest, OneDroneAloneIsATeamOfOne) {
  EXPECT_EQ(find_drones(folder_.path() / "uav0").at(0).mav0, mav0());
  EXPECT_EQ(find_drones(mav0()).at(0).mav0, mav0());
}

TEST_F(DatasetTest, FoldersWithoutADroneAreRefused) {
  EXPECT_THAT([this] { (void)find_drones(folder_.path() / "nowhere"); },
              ThrowsMessage<std::runtime_error>(HasSubstr("nowhere: is not a folder")));
  const TemporaryFolder empty;
  EXPECT_THAT([&] { (void)find_drones(empty.path()); },
              ThrowsMessage<std::runtime_error>(HasSubstr("holds no drone")));
}

// ------------------------------------------------------------------------------------ bad input

TEST_F(DatasetTest, MissingFilesAreNamed) {
  for (const char* name :
       {"cam0/sensor.yaml", "cam0/data.csv", "imu0/sensor.yaml", "imu0/data.csv"}) {
    const fs::path aside = folder_.path() / "aside";
    fs::rename(mav0() / name, aside);
    expect_refused(name, "cannot be read");
    fs::rename(aside, mav0() / name);
  }
  fs::remove(mav0() / "state_groundtruth_estimate0" / "data.csv");
  expect_refused("state_groundtruth_estimate0/data.csv", "cannot be read");
}

TEST_F(DatasetTest, ABrokenLineIsNamed) {
  write("imu0/data.csv", imu_csv() + "1115000000,0,0\n");
  expect_refused("imu0/data.csv:27: ", "3 columns, expected 7");
}

TEST_F(DatasetTest, GroundTruthInPlaceOfTheImuIsNamed) {
  for (const char* more : {"", ",0.4,0.5,0.6", ",0.4,0.5,0.6,0,0,0,0,0,0"}) {
    write("imu0/data.csv", std::string("1000000000,1,2,3,1,0,0,0") + more + "\n");
    expect_refused("imu0/data.csv:1: ", "as ground truth has; an IMU's has 7");
  }
  write("imu0/data.csv", imu_csv() + "1115000000,0,0,0,0,0,9.81,\n");
  EXPECT_EQ(read_dataset(mav0()).imu.size(), 26u) << "a comma at the end is no column";
}

TEST_F(DatasetTest, AWordInPlaceOfANumberIsNamed) {
  write("imu0/data.csv", replaced(imu_csv(), "0.03", "zero"));
  expect_refused("imu0/data.csv:2: ", "column 4 is not a number: 'zero'");
}

TEST_F(DatasetTest, NumbersThatAreNotFiniteAreRefused) {
  for (const char* bad : {"nan", "inf", "-inf", "NaN", "1e999"}) {
    write("imu0/data.csv", replaced(imu_csv(), "9.81", bad));
    expect_refused("imu0/data.csv:2: ", "column 7");
  }
}

TEST_F(DatasetTest, StampsMustBeWholeNanoseconds) {
  write("imu0/data.csv", replaced(imu_csv(), "990000000", "0.99"));
  expect_refused("imu0/data.csv:2: ", "not a whole number of nanoseconds: '0.99'");
}

TEST_F(DatasetTest, UnsortedStampsAreNamed) {
  write("imu0/data.csv", replaced(imu_csv(), "1000000000", "900000000"));
  expect_refused("imu0/data.csv:4: ", "sort the lines");
  write("imu0/data.csv", imu_csv());
  write("cam0/data.csv", "1050000000,b.png\n1000000000,a.png\n");
  expect_refused("cam0/data.csv:2: ", "sort the lines");
}

TEST_F(DatasetTest, DuplicateStampsAreNamed) {
  write("imu0/data.csv", replaced(imu_csv(), "1000000000", "995000000"));
  expect_refused("imu0/data.csv:4: ", "appears twice");
  write("imu0/data.csv", imu_csv());
  write("cam0/data.csv", "1000000000,a.png\n1000000000,b.png\n");
  expect_refused("cam0/data.csv:2: ", "appears twice");
}

TEST_F(DatasetTest, ImagesThatDoNotExistAreReportedAndNotFatalUnlessNoneDoes) {
  fs::remove(mav0() / "cam0" / "data" / "b.png");
  fs::remove(mav0() / "cam0" / "data" / "c.png");
  const Dataset dataset = read_dataset(mav0());
  EXPECT_EQ(dataset.images.size(), 3u);
  EXPECT_THAT(
      dataset.warnings,
      ElementsAre(AllOf(HasSubstr("data.csv: 2 of 3 images are not there"), HasSubstr("b.png"))));
  fs::remove(mav0() / "cam0" / "data" / "a.png");
  EXPECT_THAT([this] { (void)read_recording(mav0()); },
              ThrowsMessage<std::runtime_error>(HasSubstr("no image can be read")));
}

TEST_F(DatasetTest, EmptyFilesAreRefused) {
  write("cam0/data.csv", "#timestamp [ns],filename\n");
  expect_refused("cam0/data.csv", "lists no image");
  write("cam0/data.csv", kImages);
  write("imu0/data.csv", "");
  expect_refused("imu0/data.csv", "holds no IMU samples");
}

TEST_F(DatasetTest, ImagesThatTheImuDoesNotReachAreReported) {
  write("cam0/data.csv",
        std::string("#timestamp [ns],filename\n500000000,a.png\n1050000000,b.png\n") +
            "1900000000,c.png\n");
  EXPECT_THAT(read_dataset(mav0()).warnings,
              ElementsAre(AllOf(HasSubstr("imu0/data.csv: begins after"), HasSubstr("0.5 s")),
                          AllOf(HasSubstr("imu0/data.csv: ends before"), HasSubstr("0.8 s"))));
}

TEST_F(DatasetTest, AnImuGapIsReportedAndNotFatal) {
  std::string csv = imu_csv();
  for (int stamp = 1010; stamp <= 1040; stamp += 5) {
    csv = replaced(csv, std::to_string(stamp) + "000000,0.01,-0.02,0.03,0.1,-0.2,9.81\n", "");
  }
  write("imu0/data.csv", csv);
  const Dataset dataset = read_dataset(mav0());
  ASSERT_EQ(dataset.imu_gaps.size(), 1u);
  EXPECT_EQ(dataset.imu_gaps[0].from_ns, 1005000000);
  EXPECT_EQ(dataset.imu_gaps[0].to_ns, 1045000000);
  EXPECT_THAT(dataset.warnings, ElementsAre(AllOf(HasSubstr("imu0/data.csv"), HasSubstr("40.0 ms"),
                                                  HasSubstr("1005000000 ns"))));
}

TEST_F(DatasetTest, ImuThatDoesNotOverlapTheImagesIsRefused) {
  write("imu0/data.csv", "5000000000,0,0,0,0,0,9.81\n5005000000,0,0,0,0,0,9.81\n");
  expect_refused("imu0/data.csv", "does not overlap the images");
}

TEST_F(DatasetTest, GroundTruthThatDoesNotOverlapTheImagesIsRefused) {
  write("state_groundtruth_estimate0/data.csv",
        "5000000000,1,2,3,1,0,0,0\n5100000000,1,2,3,1,0,0,0\n");
  expect_refused("state_groundtruth_estimate0/data.csv", "does not overlap the images");
}

TEST_F(DatasetTest, QuaternionsInTheWrongOrderOrLengthAreRefused) {
  write("state_groundtruth_estimate0/data.csv",
        "1000000000,1,2,3,1,0,0,0\n1100000000,1,2,3,0,0,0,0\n");
  expect_refused("state_groundtruth_estimate0/data.csv:2: ", "quaternion's length is 0.000000");
}

TEST_F(DatasetTest, ABadCameraTransformIsRefused) {
  write("cam0/sensor.yaml", replaced(kCameraYaml, ", 0.3,", ","));
  expect_refused("cam0/sensor.yaml:6: ", "T_BS has 15 numbers, expected 16");
  write("cam0/sensor.yaml", replaced(kCameraYaml, "[0.0, -1.0", "[0.5, -1.0"));
  expect_refused("cam0/sensor.yaml:6: ", "not a rotation");
  write("cam0/sensor.yaml", replaced(kCameraYaml, "0.1,", ".nan,"));
  expect_refused("cam0/sensor.yaml:6: ", "not finite");
}

TEST_F(DatasetTest, AnImuOffTheBodyOriginIsRefused) {
  write("imu0/sensor.yaml", replaced(kImuYaml, "[1, 0, 0, 0,", "[1, 0, 0, 0.1,"));
  expect_refused("imu0/sensor.yaml", "must be the identity");
}

TEST_F(DatasetTest, UnknownCamerasAreRefused) {
  write("cam0/sensor.yaml", replaced(kCameraYaml, "radial-tangential", "fov"));
  expect_refused("cam0/sensor.yaml:14: ", "unknown distortion_model 'fov'");
  write("cam0/sensor.yaml", replaced(kCameraYaml, "pinhole", "omni"));
  expect_refused("cam0/sensor.yaml:12: ", "unknown camera_model 'omni'");
}

TEST_F(DatasetTest, MissingOrBrokenKeysAreNamed) {
  write("cam0/sensor.yaml", replaced(kCameraYaml, "intrinsics:", "intrinsic:"));
  expect_refused("cam0/sensor.yaml", "key 'intrinsics' is missing");
  write("cam0/sensor.yaml", replaced(kCameraYaml, "[64, 48]", "[64, -48]"));
  expect_refused("cam0/sensor.yaml:11: ", "resolution");
  write("cam0/sensor.yaml", replaced(kCameraYaml, "[45.5,", "[f,"));
  expect_refused("cam0/sensor.yaml:13: ", "intrinsics is not a list of numbers");
  write("cam0/sensor.yaml", replaced(kCameraYaml, "]", ""));
  expect_refused("cam0/sensor.yaml:", "not yaml");
  write("cam0/sensor.yaml", kCameraYaml);
  write("imu0/sensor.yaml", replaced(kImuYaml, "1.7e-4", "0"));
  expect_refused("imu0/sensor.yaml:5: ", "gyroscope_noise_density must be greater than zero");
}

TEST_F(DatasetTest, AnImageOfAnotherSizeIsNamed) {
  const fs::path file = mav0() / "cam0" / "data" / "a.png";
  write_png(file.string(), cv::Mat(32, 64, CV_8UC1, cv::Scalar(7)));
  const ImageEntry image{1000000000, file};
  EXPECT_EQ(read_image(image, 64, 32).at<unsigned char>(31, 63), 7);
  EXPECT_THAT([&] { (void)read_image(image, 64, 48); },
              ThrowsMessage<std::runtime_error>(
                  AllOf(HasSubstr("a.png"), HasSubstr("64x32"), HasSubstr("64x48"))));
}

TEST_F(DatasetTest, AnImageThatDoesNotDecodeIsNamed) {
  const fs::path file = write("cam0/data/a.png", "these are no pixels");
  EXPECT_THAT(
      [&] {
        (void)read_image({1000000000, file}, 64, 48);
      },
      ThrowsMessage<std::runtime_error>(HasSubstr("a.png")));
}

TEST_F(DatasetTest, AMaskIsReadWhereThereIsOne) {
  EXPECT_TRUE(read_dataset(mav0()).mask.empty());
  cv::Mat drawn(48, 64, CV_8UC1, cv::Scalar(255));
  drawn.rowRange(40, 48).setTo(3);  // not quite black, as soft brushes leave it
  const std::string file = (mav0() / "cam0" / "mask.png").string();
  write_png(file, drawn);
  const cv::Mat mask = read_dataset(mav0()).mask;
  EXPECT_EQ(cv::countNonZero(mask), 40 * 64);
  EXPECT_EQ(mask.at<unsigned char>(40, 0), 0);
}

TEST_F(DatasetTest, AMaskThatDoesNotFitIsNamed) {
  const std::string file = (mav0() / "cam0" / "mask.png").string();
  write_png(file, cv::Mat(64, 48, CV_8UC1, cv::Scalar(255)));
  expect_refused("mask.png", "64x48");
  write_png(file, cv::Mat(48, 64, CV_8UC1, cv::Scalar(0)));
  expect_refused("mask.png", "all of it is black");
  write_png(file, cv::Mat(48, 64, CV_16UC1, cv::Scalar(65535)));
  expect_refused("mask.png", "8 bits");
}

TEST(Dataset, ARecordedFlightIsRead) {
  const fs::path mav0 = fs::path(COVEY_SHARED_DATA_DIR) / "euroc_v1_01_start" / "mav0";
  if (!fs::exists(mav0)) GTEST_SKIP() << "no recorded data at " << mav0;
  const Dataset dataset = read_dataset(mav0);
  EXPECT_EQ(dataset.images.size(), 95u);
  EXPECT_EQ(dataset.imu.size(), 29120u);
  EXPECT_EQ(dataset.ground_truth->states.size(), 2895u);
  EXPECT_TRUE(dataset.warnings.empty());
  EXPECT_FALSE(read_image(dataset.images[0], dataset.camera.width, dataset.camera.height).empty());
}

TEST(DatasetName, IsItsFoldersHoweverThePathIsWritten) {
  for (const char* path :
       {"data/castle", "data/castle/", "/data/castle//", "data/yard/../castle/."})
    EXPECT_EQ(dataset_name(path), "castle") << path;
  EXPECT_EQ(dataset_name("."), std::filesystem::current_path().filename());
}

TEST(DatasetName, HasWhatTellsItFromTheOthers) {
  EXPECT_EQ(dataset_names({"a/castle", "a/yard"}), (std::vector<std::string>{"castle", "yard"}));
  EXPECT_EQ(dataset_names({"a/castle", "yard", "b/castle/"}),
            (std::vector<std::string>{"a/castle", "yard", "b/castle"}));
  EXPECT_EQ(dataset_names({"x/a/castle", "y/a/castle", "b/castle"}),
            (std::vector<std::string>{"x/a/castle", "y/a/castle", "b/castle"}));
  EXPECT_EQ(dataset_names({"/castle", "/a/castle"}),
            (std::vector<std::string>{"/castle", "a/castle"}));
  EXPECT_THAT(
      [] {
        (void)dataset_names({"a/castle", "b/castle", "./a/castle/"});
      },
      testing::ThrowsMessage<std::runtime_error>(
          testing::HasSubstr("./a/castle/: is named twice")));
}

}  // namespace
}  // namespace covey
