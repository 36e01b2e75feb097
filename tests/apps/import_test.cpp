// SPDX-License-Identifier: Apache-2.0
//
// Bags of ROS 2, written here as `ros2 bag record` writes them, and of ROS 1, written by rosbag,
// become a drone's folder.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <lz4frame.h>
#include <rosbag/bag.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sqlite3.h>
#include <zstd.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <stdexcept>
#include <string>
#include <vector>

#include "apps/bag.h"
#include "apps/camera_pixels.h"
#include "apps/dataset.h"
#include "apps/png_file.h"
#include "comms/onboard_messages.h"
#include "sim/dataset_writer.h"
#include "tests/apps/command_run.h"
#include "tests/apps/png_bytes.h"
#include "tests/apps/temporary_folder.h"
#include "tests/comms/cdr_bytes.h"

namespace covey {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::EndsWith;
using testing::HasSubstr;

constexpr TimeNs kSecond_ns = 1'000'000'000;
constexpr TimeNs kBegin_ns = 1'700'000'000 * kSecond_ns;
constexpr TimeNs kImagePeriod_ns = 50'000'000, kImuPeriod_ns = 5'000'000;

class BagWriter {
 public:
  explicit BagWriter(const fs::path& file) {
    fs::create_directories(file.parent_path());
    if (sqlite3_open(file.c_str(), &database_) != SQLITE_OK) throw std::runtime_error("no bag");
    run("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
        "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL)");
    run("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, "
        "timestamp INTEGER NOT NULL, data BLOB NOT NULL)");
    run("CREATE INDEX timestamp_idx ON messages (timestamp ASC)");
    run("BEGIN");
  }
  ~BagWriter() {
    EXPECT_EQ(sqlite3_exec(database_, "COMMIT", nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(database_);
  }
  BagWriter(const BagWriter&) = delete;
  BagWriter& operator=(const BagWriter&) = delete;

  int add_topic(const std::string& name, const std::string& type) {
    run("INSERT INTO topics(name, type, serialization_format, offered_qos_profiles) VALUES('" +
        name + "', '" + type + "', 'cdr', '')");
    return static_cast<int>(sqlite3_last_insert_rowid(database_));
  }
  void add(int topic, TimeNs stamp_ns, const Bytes& message) {
    sqlite3_stmt* row = nullptr;
    sqlite3_prepare_v2(database_,
                       "INSERT INTO messages(topic_id, timestamp, data) VALUES(?1, ?2, ?3)", -1,
                       &row, nullptr);
    sqlite3_bind_int(row, 1, topic);
    sqlite3_bind_int64(row, 2, stamp_ns);
    sqlite3_bind_blob(row, 3, message.data(), static_cast<int>(message.size()), SQLITE_TRANSIENT);
    sqlite3_step(row);
    sqlite3_finalize(row);
  }

 private:
  void run(const std::string& command) {
    if (sqlite3_exec(database_, command.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
      throw std::runtime_error(sqlite3_errmsg(database_));
  }

  sqlite3* database_ = nullptr;
};

// Records of MCAP, as https://mcap.dev/spec has them.
class McapBytes {
 public:
  template <typename Unsigned>
  McapBytes& put(Unsigned value) {
    for (std::size_t i = 0; i < sizeof(Unsigned); ++i)
      bytes_.push_back(static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i) & 0xffU));
    return *this;
  }
  McapBytes& text(const std::string& value) {
    put(static_cast<std::uint32_t>(value.size()));
    return raw(value);
  }
  McapBytes& raw(const std::string& value) {
    bytes_ += value;
    return *this;
  }
  McapBytes& record(std::uint8_t kind, const McapBytes& content) {
    return put(kind).put(std::uint64_t{content.bytes_.size()}).raw(content.bytes_);
  }
  McapBytes& message(std::uint16_t channel, TimeNs stamp_ns, const Bytes& data) {
    const auto stamp = static_cast<std::uint64_t>(stamp_ns);
    McapBytes content;
    content.put(channel).put(std::uint32_t{0}).put(stamp).put(stamp);
    return record(5, content.raw({data.begin(), data.end()}));
  }
  // These records as a chunk.
  [[nodiscard]] McapBytes chunk(const std::string& compression) const {
    std::string records = bytes_;
    if (compression == "zstd") {
      records.resize(ZSTD_compressBound(bytes_.size()));
      records.resize(
          ZSTD_compress(records.data(), records.size(), bytes_.data(), bytes_.size(), 1));
    }
    if (compression == "lz4") {
      records.resize(LZ4F_compressFrameBound(bytes_.size(), nullptr));
      records.resize(LZ4F_compressFrame(records.data(), records.size(), bytes_.data(),
                                        bytes_.size(), nullptr));
    }
    McapBytes content;
    content.put(std::uint64_t{0}).put(std::uint64_t{0}).put(std::uint64_t{bytes_.size()});
    content.put(std::uint32_t{0}).text(compression).put(std::uint64_t{records.size()});
    return McapBytes().record(6, content.raw(records));
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }

 private:
  std::string bytes_;
};

const std::string kMcapBegin("\x89MCAP0\r\n");

McapBytes mcap_topic(std::uint16_t id, const std::string& name, const std::string& type,
                     const std::string& encoding = "cdr") {
  McapBytes schema, channel;
  schema.put(id).text(type).text("ros2msg").text("");
  channel.put(id).put(id).text(name).text(encoding).text("");
  return McapBytes().record(3, schema).record(4, channel);
}

CameraImage image_at(int index, int width, int height, int bytes_per_pixel) {
  CameraImage image;
  image.stamp_ns = kBegin_ns + index * kImagePeriod_ns;
  image.width = width;
  image.height = height;
  image.bytes_per_pixel = bytes_per_pixel;
  for (int i = 0; i < width * height * bytes_per_pixel; ++i)
    image.pixels.push_back(static_cast<std::uint8_t>(7 * i + index));
  return image;
}

ImuSample sample_at(int index) {
  return {kBegin_ns + index * kImuPeriod_ns, {0.01, 0.02, 0.001 * index}, {0.1, -0.2, 9.81}};
}

class Import : public testing::Test {
 protected:
  Import() {
    fs::create_directories(sensors() / "cam0");
    fs::create_directories(sensors() / "imu0");
    write_camera(kWidth);
    write_imu_file(sensors() / "imu0" / "sensor.yaml", ImuNoise(), 200, "an IMU");
  }

  [[nodiscard]] fs::path sensors() const { return folder_.path() / "calibration"; }
  [[nodiscard]] fs::path bag() const { return folder_.path() / "bag"; }
  [[nodiscard]] fs::path out() const { return folder_.path() / "team" / "uav0"; }
  [[nodiscard]] std::string command(const std::string& more = "") const {
    return "import " + bag().string() + " --sensors " + sensors().string() + " --out " +
           out().string() + " " + more;
  }

  void write_camera(int width) const {
    CameraDescription camera;
    camera.intrinsics.width = width;
    camera.intrinsics.height = kHeight;
    camera.intrinsics.fx = camera.intrinsics.fy = 10;
    write_camera_file(sensors() / "cam0" / "sensor.yaml", camera);
  }

  // Images `from` .. `until` and the IMU from one period before the first to one after the last.
  void record(const std::string& file, int from, int until, int bytes_per_pixel = 1) const {
    BagWriter writer(bag() / file);
    const int camera = writer.add_topic("/camera/image_raw", "sensor_msgs/msg/Image");
    const int imu = writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu");
    writer.add_topic("/tf", "tf2_msgs/msg/TFMessage");
    constexpr int kRatio = kImagePeriod_ns / kImuPeriod_ns;
    for (int i = kRatio * (from - 1); i < kRatio * (until + 1); ++i)
      writer.add(imu, sample_at(i).stamp_ns, encode(sample_at(i)));
    for (int i = from; i < until; ++i) {
      const CameraImage image = image_at(i, kWidth, kHeight, bytes_per_pixel);
      writer.add(camera, image.stamp_ns, encode(image));
    }
  }

  static constexpr int kWidth = 8, kHeight = 6;
  TemporaryFolder folder_;
};

TEST_F(Import, WhatWasRecordedIsInTheFolder) {
  record("flight_0.db3", 0, 5);
  run_command(command());
  const Dataset dataset = read_recording(out() / "mav0");
  ASSERT_EQ(dataset.images.size(), 5U);
  for (int i = 0; i < 5; ++i) {
    const CameraImage recorded = image_at(i, kWidth, kHeight, 1);
    const ImageEntry& entry = dataset.images[static_cast<std::size_t>(i)];
    EXPECT_EQ(entry.stamp_ns, recorded.stamp_ns);
    const cv::Mat pixels = read_image(entry, kWidth, kHeight);
    EXPECT_EQ(std::vector<std::uint8_t>(pixels.datastart, pixels.dataend), recorded.pixels);
  }
  ASSERT_EQ(dataset.imu.size(), 70U);
  EXPECT_EQ(dataset.imu.front().stamp_ns, sample_at(-10).stamp_ns);
  EXPECT_LT((dataset.imu[30].gyro_imu - sample_at(20).gyro_imu).norm(), 1e-9);
  EXPECT_LT((dataset.imu[30].accel_imu - sample_at(20).accel_imu).norm(), 1e-9);
}

TEST_F(Import, TheCamerasMaskGoesWithItsCalibration) {
  record("flight_0.db3", 0, 5);
  cv::Mat mask(kHeight, kWidth, CV_8UC1, cv::Scalar(255));
  mask.row(0).setTo(0);
  write_png((sensors() / "cam0" / "mask.png").string(), mask);
  run_command(command());
  EXPECT_EQ(cv::countNonZero(read_dataset(out() / "mav0").mask), kWidth * (kHeight - 1));
}

TEST_F(Import, SixteenBitsStaySixteenBits) {
  record("flight_0.db3", 0, 3, 2);
  run_command(command());
  const Dataset dataset = read_recording(out() / "mav0");
  EXPECT_TRUE(dataset.thermal);
  const cv::Mat pixels = read_image(dataset.images[1], kWidth, kHeight);
  ASSERT_EQ(pixels.type(), CV_16UC1);
  EXPECT_EQ(std::vector<std::uint8_t>(pixels.datastart, pixels.dataend),
            image_at(1, kWidth, kHeight, 2).pixels);
}

TEST_F(Import, FilesOfOneRecordingAreReadInItsOrder) {
  record("flight_10.db3", 6, 9);
  record("flight_9.db3", 0, 5);
  run_command(command());
  const Dataset dataset = read_recording(out() / "mav0");
  ASSERT_EQ(dataset.images.size(), 8U);
  EXPECT_EQ(dataset.images[5].stamp_ns, image_at(6, kWidth, kHeight, 1).stamp_ns);
  EXPECT_EQ(Bag(bag()).topics().front().messages, 8U);
}

TEST_F(Import, FlightsOfDifferentTimesArePutSideBySide) {
  record("flight_0.db3", 0, 3);
  run_command(command("--first-stamp 1000"));
  const Dataset dataset = read_recording(out() / "mav0");
  EXPECT_EQ(dataset.images.front().stamp_ns, 1000 * kSecond_ns);
  EXPECT_EQ(dataset.images.back().stamp_ns, 1000 * kSecond_ns + 2 * kImagePeriod_ns);
  EXPECT_EQ(dataset.imu.front().stamp_ns, 1000 * kSecond_ns - 10 * kImuPeriod_ns);
}

TEST_F(Import, WhatIsThereAlreadyIsRefusedWithoutAdviceThatCannotBeTaken) {
  record("flight_0.db3", 0, 3);
  run_command(command());
  EXPECT_THAT(complaint_of(command()), EndsWith("exists already; choose another --out"));
}

TEST_F(Import, AFirstStampBeforeWhichTheImuBeginsIsTooEarly) {
  {
    BagWriter writer(bag() / "flight_0.db3");
    const int imu = writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu");
    for (int i = -600; i < -10; ++i) writer.add(imu, sample_at(i).stamp_ns, encode(sample_at(i)));
  }
  record("flight_1.db3", 0, 3);
  EXPECT_THAT(complaint_of(command("--first-stamp 1")),
              HasSubstr("--first-stamp 1 is too early: the IMU begins 3.000 s before"));
  EXPECT_FALSE(fs::exists(out()));
  run_command(command("--first-stamp 3"));
  EXPECT_EQ(read_recording(out() / "mav0").imu.front().stamp_ns, 0);
}

TEST_F(Import, WhatCannotBeUsedIsLeftOut) {
  record("flight_0.db3", 0, 3);
  {
    BagWriter writer(bag() / "flight_1.db3");
    const int camera = writer.add_topic("/camera/image_raw", "sensor_msgs/msg/Image");
    const int imu = writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu");
    const TimeNs later_ns = kBegin_ns + kSecond_ns;
    writer.add(camera, later_ns, {1, 2, 3});
    writer.add(camera, later_ns, encode(image_at(2, kWidth, kHeight, 1)));  // said twice
    writer.add(imu, later_ns, encode(sample_at(5)));
    writer.add(imu, later_ns, Bytes(40, 0xff));
    ImuSample late = sample_at(5);
    late.stamp_ns += kImuPeriod_ns / 2;
    writer.add(imu, later_ns, encode(late));
  }
  run_command(command());
  const Dataset dataset = read_recording(out() / "mav0");
  EXPECT_EQ(dataset.images.size(), 3U);
  EXPECT_EQ(dataset.imu.size(), 51U) << "the late one is put where it belongs";
}

constexpr TimeNs kHour_ns = 3600 * kSecond_ns;

TEST_F(Import, AWrongStampCostsItsOwnSampleAlone) {
  for (const TimeNs wrong_ns : {-kHour_ns, kHour_ns}) {
    for (const int wrong : {0, 10, 19}) {
      {
        BagWriter writer(bag() / "flight_0.db3");
        const int camera = writer.add_topic("/camera/image_raw", "sensor_msgs/msg/Image");
        const int imu = writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu");
        for (int i = 0; i < 20; ++i) {
          CameraImage image = image_at(i, kWidth, kHeight, 1);
          ImuSample sample = sample_at(i);
          if (i == wrong) image.stamp_ns += wrong_ns;
          if (i == wrong) sample.stamp_ns += wrong_ns;
          writer.add(camera, kBegin_ns + i, encode(image));
          writer.add(imu, kBegin_ns + i, encode(sample));
        }
      }
      run_command(command());
      const Dataset dataset = read_recording(out() / "mav0");
      const int first = wrong == 0 ? 1 : 0;
      EXPECT_EQ(dataset.images.size(), 19U) << wrong;
      EXPECT_EQ(dataset.images.front().stamp_ns, kBegin_ns + first * kImagePeriod_ns) << wrong;
      EXPECT_EQ(dataset.imu.size(), 19U) << wrong;
      EXPECT_EQ(dataset.imu.front().stamp_ns, sample_at(first).stamp_ns) << wrong;
      fs::remove_all(folder_.path() / "team");
      fs::remove_all(bag());
    }
  }
}

TEST_F(Import, AnImuWhoseClockIsSetBackIsLeftOutUntilItHasCaughtUp) {
  record("flight_0.db3", 0, 80);  // the last sample is that of index 809
  {
    BagWriter writer(bag() / "flight_1.db3");
    const int imu = writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu");
    for (int i = 420; i < 820; ++i) {
      ImuSample sample = sample_at(i);
      sample.stamp_ns += kImuPeriod_ns / 2;
      writer.add(imu, sample.stamp_ns, encode(sample));
    }
  }
  run_command(command());
  EXPECT_EQ(read_recording(out() / "mav0").imu.size(), 820U + 11U) << "from index 809 on";
}

TEST_F(Import, AnImageOfAnotherSizeIsLeftOutAlone) {
  record("flight_0.db3", 0, 3);
  {
    BagWriter writer(bag() / "flight_1.db3");
    const int camera = writer.add_topic("/camera/image_raw", "sensor_msgs/msg/Image");
    const CameraImage image = image_at(3, 2 * kWidth, kHeight, 1);
    writer.add(camera, image.stamp_ns, encode(image));
  }
  record("flight_2.db3", 4, 6);
  run_command(command());
  EXPECT_EQ(read_recording(out() / "mav0").images.size(), 5U);
}

TEST_F(Import, AnAutopilotsImuIsFlownToo) {
  record("flight_0.db3", 0, 3);
  {
    BagWriter writer(bag() / "flight_1.db3");
    const int imu = writer.add_topic("/fmu/out/sensor_combined", "px4_msgs/msg/SensorCombined");
    for (int i = 0; i < 30; ++i)
      writer.add(imu, sample_at(i).stamp_ns, encode_px4_imu(sample_at(i)));
  }
  EXPECT_THAT(complaint_of(command()), AllOf(HasSubstr("/fmu/out/sensor_combined, /imu/data_raw"),
                                             HasSubstr("--imu-topic")));
  run_command(command("--imu-topic /fmu/out/sensor_combined"));
  const Dataset dataset = read_recording(out() / "mav0");
  ASSERT_EQ(dataset.imu.size(), 30U);
  EXPECT_LT((dataset.imu[3].accel_imu - sample_at(3).accel_imu).norm(), 1e-5);
}

Bytes packed_message(TimeNs stamp_ns, const std::string& format, const Bytes& file) {
  return CdrBytes()
      .header(static_cast<std::int32_t>(stamp_ns / kSecond_ns),
              static_cast<std::uint32_t>(stamp_ns % kSecond_ns))
      .text(format)
      .octets(file)
      .bytes();
}

TEST_F(Import, PackedImagesAreFlownWhereNoOthersAreThereOrWhereNamed) {
  record("flight_0.db3", 0, 3);
  const std::string kName = "/camera/image_raw/compressed";
  {
    BagWriter writer(bag() / "flight_1.db3");
    const int camera = writer.add_topic(kName, "sensor_msgs/msg/CompressedImage");
    for (int i = 0; i < 2; ++i) {
      CameraImage image = image_at(i, kWidth, kHeight, 2);
      writer.add(
          camera, image.stamp_ns,
          packed_message(image.stamp_ns, "mono16; png compressed ", png_of(pixels_of(image))));
    }
    writer.add(camera, kBegin_ns + kSecond_ns,
               packed_message(kBegin_ns + kSecond_ns, "16UC1; compressedDepth png", {1}));
  }
  run_command(command());
  EXPECT_EQ(read_recording(out() / "mav0").images.size(), 3U);
  fs::remove_all(out());
  run_command(command("--image-topic " + kName));
  const Dataset dataset = read_recording(out() / "mav0");
  ASSERT_EQ(dataset.images.size(), 2U);
  const cv::Mat pixels = read_image(dataset.images[1], kWidth, kHeight);
  EXPECT_EQ(std::vector<std::uint8_t>(pixels.datastart, pixels.dataend),
            image_at(1, kWidth, kHeight, 2).pixels);
}

// Three images and 50 IMU samples, and what nobody asks for.
McapBytes recorded_mcap(int width, int height) {
  McapBytes records;
  records.raw(mcap_topic(1, "/camera/image_raw", "sensor_msgs/msg/Image").bytes())
      .raw(mcap_topic(7, "/imu/data_raw", "sensor_msgs/msg/Imu").bytes())
      .raw(mcap_topic(8, "/words", "std_msgs/msg/String", "json").bytes())
      .message(8, kBegin_ns, {1, 2, 3});
  for (int i = -10; i < 40; ++i) records.message(7, sample_at(i).stamp_ns, encode(sample_at(i)));
  for (int i = 0; i < 3; ++i) {
    const CameraImage image = image_at(i, width, height, 1);
    records.message(1, image.stamp_ns, encode(image));
  }
  return records;
}

TEST_F(Import, McapIsReadInChunksPackedOrNot) {
  const McapBytes records = recorded_mcap(kWidth, kHeight);
  const McapBytes end = McapBytes().record(15, McapBytes().put(std::uint32_t{0}));
  for (const McapBytes& data :
       {records, records.chunk(""), records.chunk("zstd"), records.chunk("lz4")}) {
    const std::string file = McapBytes().raw(kMcapBegin).raw(data.bytes()).raw(end.bytes()).bytes();
    folder_.write("bag/flight_0.mcap", file);
    run_command(command());
    const Dataset dataset = read_recording(out() / "mav0");
    ASSERT_EQ(dataset.images.size(), 3U);
    ASSERT_EQ(dataset.imu.size(), 50U);
    EXPECT_LT((dataset.imu[17].gyro_imu - sample_at(7).gyro_imu).norm(), 1e-9);
    const cv::Mat pixels = read_image(dataset.images[2], kWidth, kHeight);
    EXPECT_EQ(std::vector<std::uint8_t>(pixels.datastart, pixels.dataend),
              image_at(2, kWidth, kHeight, 1).pixels);
    fs::remove_all(out());
  }
}

TEST_F(Import, McapThatWasCutShortIsReadAsFarAsItGoes) {
  std::string file = kMcapBegin + recorded_mcap(kWidth, kHeight).bytes();
  file.resize(file.size() - 5);
  folder_.write("bag/flight_0.mcap", file);
  run_command(command());
  EXPECT_EQ(read_recording(out() / "mav0").images.size(), 2U);
}

TEST_F(Import, McapThatMakesNoSenseIsRefused) {
  const McapBytes records = recorded_mcap(kWidth, kHeight);
  const auto complaint = [&](const std::string& after_begin) {
    folder_.write("bag/flight_0.mcap", kMcapBegin + after_begin);
    return complaint_of(command());
  };
  EXPECT_THAT(complaint(McapBytes().put(std::uint8_t{5}).put(~std::uint64_t{0}).bytes()),
              HasSubstr("flight_0.mcap: no MCAP file that can be read: record too large"));
  EXPECT_THAT(complaint(McapBytes().record(3, McapBytes().put(std::uint8_t{1})).bytes()),
              HasSubstr("fields end too early"));
  EXPECT_THAT(complaint(records.chunk("snappy").bytes()), HasSubstr("compressed by snappy"));
  std::string broken = records.chunk("lz4").bytes();
  broken[broken.find("\x04\x22\x4d\x18")] = 0;  // lz4's own beginning
  EXPECT_THAT(complaint(broken), HasSubstr("cannot be unpacked"));
  std::string packed = records.chunk("zstd").bytes();
  packed[packed.find("\x28\xb5\x2f\xfd")] = 0;  // zstd's own beginning
  EXPECT_THAT(complaint(packed), HasSubstr("cannot be unpacked"));
  EXPECT_THAT(complaint(""), HasSubstr("no topic of sensor_msgs/msg/Image"));
}

ros::Time ros1_time(TimeNs stamp_ns) {
  ros::Time time;
  time.fromNSec(static_cast<std::uint64_t>(stamp_ns));
  return time;
}

sensor_msgs::Image ros1(const CameraImage& image) {
  sensor_msgs::Image out;
  out.header.stamp = ros1_time(image.stamp_ns);
  out.header.frame_id = "cam0";
  out.width = static_cast<std::uint32_t>(image.width);
  out.height = static_cast<std::uint32_t>(image.height);
  out.step = static_cast<std::uint32_t>(image.width * image.bytes_per_pixel);
  out.encoding = image.bytes_per_pixel == 1 ? "mono8" : "mono16";
  out.data = image.pixels;
  return out;
}

sensor_msgs::Imu ros1(const ImuSample& sample) {
  sensor_msgs::Imu out;
  out.header.stamp = ros1_time(sample.stamp_ns);
  out.angular_velocity.x = sample.gyro_imu.x();
  out.angular_velocity.y = sample.gyro_imu.y();
  out.angular_velocity.z = sample.gyro_imu.z();
  out.linear_acceleration.x = sample.accel_imu.x();
  out.linear_acceleration.y = sample.accel_imu.y();
  out.linear_acceleration.z = sample.accel_imu.z();
  return out;
}

// Images `from` .. `until` of two bytes a pixel, and the IMU from 0.05 s before to 0.05 s after.
void record_ros1(const fs::path& file, int from, int until, int width, int height,
                 rosbag::CompressionType compression = rosbag::compression::Uncompressed) {
  fs::create_directories(file.parent_path());
  rosbag::Bag bag(file.string(), rosbag::bagmode::Write);
  bag.setCompression(compression);
  constexpr int kRatio = kImagePeriod_ns / kImuPeriod_ns;
  for (int i = kRatio * (from - 1); i < kRatio * (until + 1); ++i)
    bag.write("/imu0", ros1_time(sample_at(i).stamp_ns), ros1(sample_at(i)));
  for (int i = from; i < until; ++i) {
    const CameraImage image = image_at(i, width, height, 2);
    bag.write("/cam0/image_raw", ros1_time(image.stamp_ns), ros1(image));
  }
}

TEST_F(Import, BagsOfRos1AreReadPackedOrNot) {
  for (const auto compression :
       {rosbag::compression::Uncompressed, rosbag::compression::BZ2, rosbag::compression::LZ4}) {
    record_ros1(bag() / "flight.bag", 0, 3, kWidth, kHeight, compression);
    run_command(command());
    const Dataset dataset = read_recording(out() / "mav0");
    ASSERT_EQ(dataset.images.size(), 3U);
    EXPECT_EQ(dataset.images[1].stamp_ns, image_at(1, kWidth, kHeight, 2).stamp_ns);
    const cv::Mat pixels = read_image(dataset.images[1], kWidth, kHeight);
    EXPECT_EQ(std::vector<std::uint8_t>(pixels.datastart, pixels.dataend),
              image_at(1, kWidth, kHeight, 2).pixels);
    ASSERT_EQ(dataset.imu.size(), 50U);
    EXPECT_LT((dataset.imu[17].gyro_imu - sample_at(7).gyro_imu).norm(), 1e-9);
    EXPECT_LT((dataset.imu[17].accel_imu - sample_at(7).accel_imu).norm(), 1e-9);
    fs::remove_all(out());
  }
}

TEST_F(Import, PackedImagesOfRos1AreFlown) {
  record_ros1(bag() / "flight_0.bag", 0, 0, kWidth, kHeight);
  {
    rosbag::Bag writer((bag() / "flight_1.bag").string(), rosbag::bagmode::Write);
    for (int i = 0; i < 2; ++i) {
      CameraImage image = image_at(i, kWidth, kHeight, 1);
      sensor_msgs::CompressedImage packed;
      packed.header.stamp = ros1_time(image.stamp_ns);
      packed.format = "mono8; png compressed ";
      packed.data = png_of(pixels_of(image));
      writer.write("/cam0/image_raw/compressed", ros1_time(image.stamp_ns), packed);
    }
  }
  run_command(command());
  const Dataset dataset = read_recording(out() / "mav0");
  ASSERT_EQ(dataset.images.size(), 2U);
  const cv::Mat pixels = read_image(dataset.images[1], kWidth, kHeight);
  EXPECT_EQ(std::vector<std::uint8_t>(pixels.datastart, pixels.dataend),
            image_at(1, kWidth, kHeight, 1).pixels);
}

TEST_F(Import, BagsOfOneRecordingOfRos1AreReadAsOne) {
  record_ros1(bag() / "flight_1.bag", 3, 5, kWidth, kHeight);
  record_ros1(bag() / "flight_0.bag", 0, 3, kWidth, kHeight);
  EXPECT_EQ(Bag(bag()).topics().front().messages, 5U);
  run_command(command());
  EXPECT_EQ(read_recording(out() / "mav0").images.size(), 5U);
}

TEST_F(Import, BagsOfRos1ThatCannotBeReadAreNamed) {
  const fs::path file = bag() / "flight.bag";
  folder_.write("bag/flight.bag", "no bag");
  EXPECT_THAT(complaint_of(command()), HasSubstr("flight.bag: no bag of ROS 1"));
  record_ros1(file, 0, 3, kWidth, kHeight);
  EXPECT_THAT(complaint_of(command("--imu-topic /cam0/image_raw")),
              HasSubstr("no topic /cam0/image_raw of type sensor_msgs/msg/Imu"));
  std::ifstream in(file, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const std::size_t packing = bytes.find("compression=none");
  ASSERT_NE(packing, std::string::npos);
  bytes.replace(packing, 16, "compression=nine");
  folder_.write("bag/flight.bag", bytes);
  EXPECT_THAT(complaint_of(command()), HasSubstr("compressed by nine"));
  EXPECT_FALSE(fs::exists(out()));
}

TEST_F(Import, BagsOfRos1ThatWereCutShortAreReadAsFarAsTheyGo) {
  const fs::path file = bag() / "flight_1.bag";
  record_ros1(bag() / "flight_0.bag", 0, 3, kWidth, kHeight);
  record_ros1(file, 3, 5, kWidth, kHeight);
  for (std::uintmax_t size = fs::file_size(file) - 1; size > 20; size = 9 * size / 10) {
    fs::resize_file(file, size);
    run_command(command());
    const std::size_t images = read_recording(out() / "mav0").images.size();
    EXPECT_TRUE(images == 3 || images == 5) << images << " of " << size << " bytes";
    fs::remove_all(out());
  }
}

TEST_F(Import, WhatIsWrongIsSaidInOneLineAndNothingIsWritten) {
  EXPECT_THAT(complaint_of(command()), HasSubstr("bag: does not exist"));
  fs::create_directories(bag());
  EXPECT_THAT(complaint_of(command()), HasSubstr("holds no .db3, .mcap or .bag file"));
  folder_.write("bag/flight_0.db3", "not a database, though it is long enough to be one");
  EXPECT_THAT(complaint_of(command()), HasSubstr("flight_0.db3: no bag of ROS 2"));
  fs::remove(bag() / "flight_0.db3");
  folder_.write("bag/flight_0.mcap", "");
  EXPECT_THAT(complaint_of(command()), HasSubstr("flight_0.mcap: no MCAP file"));
  fs::remove(bag() / "flight_0.mcap");
  folder_.write("bag/flight_0.db3.zstd", "");
  EXPECT_THAT(complaint_of(command()), HasSubstr("zstd -d"));
  fs::remove(bag() / "flight_0.db3.zstd");
  record("flight_0.db3", 0, 3);
  EXPECT_THAT(complaint_of(command("--image-topic /imu/data_raw")),
              HasSubstr("no topic /imu/data_raw of type sensor_msgs/msg/Image; topics: "
                        "/camera/image_raw, /imu/data_raw, /tf"));
  folder_.write("calibration/cam0/sensor.yaml", "rate_hz: 20\n");
  EXPECT_THAT(complaint_of(command()), HasSubstr("sensor.yaml"));
  EXPECT_FALSE(fs::exists(out()));
  EXPECT_TRUE(!fs::exists(out().parent_path()) || fs::is_empty(out().parent_path()));
}

TEST_F(Import, ImagesOfAnotherSizeThanTheCalibrationsAreRefused) {
  write_camera(2 * kWidth);
  record("flight_0.db3", 0, 3);
  EXPECT_THAT(complaint_of(command()),
              AllOf(HasSubstr("/camera/image_raw: nothing of it can be used: an image of 8x6"),
                    HasSubstr("camera of 16x6")));
  EXPECT_TRUE(fs::is_empty(out().parent_path()));
}

TEST_F(Import, ATopicOfWhichNothingCanBeUsedIsNamed) {
  {
    BagWriter writer(bag() / "flight_0.db3");
    const int camera = writer.add_topic("/camera/image_raw", "sensor_msgs/msg/Image");
    const int imu = writer.add_topic("/imu/data_raw", "sensor_msgs/msg/Imu");
    writer.add(camera, kBegin_ns, Bytes(40, 0x28));  // as compressed messages are
    writer.add(imu, kBegin_ns, encode(sample_at(0)));
  }
  EXPECT_THAT(complaint_of(command()), HasSubstr("/camera/image_raw: nothing of it can be used"));
}

}  // namespace
}  // namespace covey
