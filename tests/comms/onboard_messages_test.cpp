// SPDX-License-Identifier: Apache-2.0
//
// Messages of ROS 2 and PX4: byte by byte as others write them, and what is refused.
#include "comms/onboard_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <random>

#include "comms/cdr.h"
#include "comms/image_pixels.h"
#include "estimator/so3.h"
#include "idl/onboard.h"
#include "tests/comms/cdr_bytes.h"
#include "tests/comms/samples.h"

namespace covey {
namespace {

using NavOdometry = nav_msgs::msg::dds_::Odometry_;
using Px4Odometry = px4_msgs::msg::dds_::VehicleOdometry_;
using testing::ElementsAre;

constexpr TimeNs kStamp_ns = 1'700'000'000'123'456'789;

// What is different in an image from one that is well.
struct ImageFields {
  std::uint32_t height = 2, width = 3, step = 3;
  std::string encoding = "mono8";
  std::uint8_t is_bigendian = 0;
  std::vector<std::uint8_t> data = {1, 2, 3, 4, 5, 6};
};

Bytes image_bytes(const ImageFields& image) {
  return CdrBytes()
      .header()
      .put(image.height)
      .put(image.width)
      .text(image.encoding)
      .put(image.is_bigendian)
      .put(image.step)
      .octets(image.data)
      .bytes();
}

Bytes imu_bytes(double gyro_x, std::uint32_t nanosec = 123'456'789) {
  CdrBytes out;
  out.header(1'700'000'000, nanosec);
  for (const double q : {0.0, 0.0, 0.0, 1.0}) out.put(q);
  out.put(-1.0);
  for (int i = 1; i < 9; ++i) out.put(0.0);
  for (const double w : {gyro_x, 0.2, 0.3}) out.put(w);
  for (int i = 0; i < 9; ++i) out.put(0.01);
  for (const double a : {1.0, 2.0, 9.81}) out.put(a);
  for (int i = 0; i < 9; ++i) out.put(0.02);
  return out.bytes();
}

CameraImage decoded_image(const ImageFields& fields) {
  const auto decoded = decode_image(image_bytes(fields));
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) {
    ADD_FAILURE() << rejected->reason;
    return {};
  }
  return std::get<CameraImage>(decoded);
}

template <typename Message>
std::string reason(const Decoded<Message>& decoded) {
  const auto* rejected = std::get_if<Rejected>(&decoded);
  return rejected != nullptr ? rejected->reason : "accepted";
}

template <typename Wire>
Wire read(const Bytes& bytes) {
  return std::get<Wire>(from_cdr<Wire>(bytes));
}

TEST(OnboardMessages, AnImageIsReadAsRos2WritesIt) {
  const CameraImage image = decoded_image({});
  EXPECT_EQ(image.stamp_ns, kStamp_ns);
  EXPECT_EQ(image.width, 3);
  EXPECT_EQ(image.height, 2);
  EXPECT_EQ(image.bytes_per_pixel, 1);
  EXPECT_THAT(image.pixels, ElementsAre(1, 2, 3, 4, 5, 6));
}

TEST(OnboardMessages, GapsBetweenRowsAreLeftOut) {
  ImageFields padded;
  padded.step = 4;
  padded.data = {1, 2, 3, 99, 4, 5, 6, 99};
  EXPECT_THAT(decoded_image(padded).pixels, ElementsAre(1, 2, 3, 4, 5, 6));
}

TEST(OnboardMessages, SixteenBitsAreReadInEitherByteOrder) {
  for (const bool big : {false, true}) {
    ImageFields fields;
    fields.encoding = big ? "16UC1" : "mono16";
    fields.width = fields.height = 1;
    fields.step = 2;
    fields.is_bigendian = big ? 1 : 0;
    fields.data =
        big ? std::vector<std::uint8_t>{0x12, 0x34} : std::vector<std::uint8_t>{0x34, 0x12};
    const CameraImage image = decoded_image(fields);
    ASSERT_EQ(image.pixels.size(), 2U);
    std::uint16_t grey = 0;
    std::memcpy(&grey, image.pixels.data(), 2);
    EXPECT_EQ(grey, 0x1234);
    EXPECT_EQ(image.bytes_per_pixel, 2);
  }
}

// Red, green, blue and grey, each of the brightness that it has by ITU-R BT.601.
TEST(OnboardMessages, OfColoursTheBrightnessIsRead) {
  const std::vector<std::array<std::uint8_t, 3>> rgb = {
      {255, 0, 0}, {0, 255, 0}, {0, 0, 255}, {90, 90, 90}};
  const auto read_as = [&](const std::string& encoding, bool blue_first, bool alpha) {
    ImageFields fields;
    fields.encoding = encoding;
    fields.width = 2;
    fields.data.clear();
    for (std::size_t i = 0; i < rgb.size(); ++i) {
      for (std::size_t k = 0; k < 3; ++k) fields.data.push_back(rgb[i][blue_first ? 2 - k : k]);
      if (alpha) fields.data.push_back(200);
      if (i % 2 == 1) fields.data.push_back(99);  // at the end of each row
    }
    fields.step = static_cast<std::uint32_t>(fields.data.size() / 2);
    const CameraImage image = decoded_image(fields);
    EXPECT_EQ(image.bytes_per_pixel, 1) << encoding;
    return image.pixels;
  };
  const auto grey = ElementsAre(77, 149, 29, 90);
  EXPECT_THAT(read_as("rgb8", false, false), grey);
  EXPECT_THAT(read_as("bgr8", true, false), grey);
  EXPECT_THAT(read_as("rgba8", false, true), grey);
  EXPECT_THAT(read_as("bgra8", true, true), grey);
}

TEST(OnboardMessages, AMosaicAndBrightnessBesideColourAreReadAsGreyOfOneByte) {
  ImageFields mosaic;
  mosaic.encoding = "bayer_rggb8";
  mosaic.data = {40, 100, 40, 100, 200, 100};
  EXPECT_THAT(decoded_image(mosaic).pixels, ElementsAre(110, 110, 110, 110, 110, 110));
  ImageFields beside;
  beside.encoding = "uyvy";
  beside.width = 2;
  beside.step = 4;
  beside.data = {1, 10, 2, 20, 3, 30, 4, 40};
  const CameraImage image = decoded_image(beside);
  EXPECT_THAT(image.pixels, ElementsAre(10, 20, 30, 40));
  EXPECT_EQ(image.bytes_per_pixel, 1);
}

Bytes packed_image_bytes(const std::string& format, std::uint32_t nanosec = 123'456'789) {
  return CdrBytes().header(1'700'000'000, nanosec).text(format).octets({1, 2, 3}).bytes();
}

TEST(OnboardMessages, APackedImageIsReadAsRos2WritesIt) {
  const auto decoded = decode_packed_image(packed_image_bytes("mono8; jpeg compressed "));
  ASSERT_EQ(reason(decoded), "accepted");
  const auto& image = std::get<PackedImage>(decoded);
  EXPECT_EQ(image.stamp_ns, kStamp_ns);
  EXPECT_EQ(image.format, "mono8; jpeg compressed ");
  EXPECT_THAT(image.file, ElementsAre(1, 2, 3));
}

TEST(OnboardMessages, APackedImageOfDepthsOrThatEndsTooEarlyIsRefused) {
  EXPECT_EQ(reason(decode_packed_image(packed_image_bytes("16UC1; compressedDepth png"))),
            "depths instead of brightness");
  EXPECT_EQ(reason(decode_packed_image(packed_image_bytes("jpeg", 1'000'000'000))),
            "no valid stamp");
  const Bytes whole = packed_image_bytes("jpeg");
  for (std::size_t size = 0; size < whole.size(); ++size) {
    const Bytes begin(whole.begin(), whole.begin() + static_cast<long>(size));
    EXPECT_NE(reason(decode_packed_image(begin)), "accepted") << size;
  }
}

TEST(OnboardMessages, AnImuSampleIsReadAsRos2WritesIt) {
  const auto decoded = decode_imu(imu_bytes(0.1));
  ASSERT_EQ(reason(decoded), "accepted");
  const auto& sample = std::get<ImuSample>(decoded);
  EXPECT_EQ(sample.stamp_ns, kStamp_ns);
  EXPECT_EQ(sample.gyro_imu, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(sample.accel_imu, Eigen::Vector3d(1, 2, 9.81));
}

Bytes px4_imu_bytes(float gyro_y, std::int32_t accelerometer_at = 0) {
  CdrBytes out;
  out.put(std::uint64_t{1'700'000'000'123'456});
  for (const float w : {0.1F, gyro_y, 0.3F}) out.put(w);
  out.put(std::uint32_t{5000}).put(accelerometer_at);
  for (const float a : {1.0F, 2.0F, -9.8125F}) out.put(a);
  out.put(std::uint32_t{5000});
  for (int i = 0; i < 4; ++i) out.put(std::uint8_t{0});
  return out.bytes();
}

TEST(OnboardMessages, AnAutopilotsImuIsReadAsPx4WritesIt) {
  const auto decoded = decode_px4_imu(px4_imu_bytes(0.25F));
  ASSERT_EQ(reason(decoded), "accepted");
  const auto& sample = std::get<ImuSample>(decoded);
  EXPECT_EQ(sample.stamp_ns, 1'700'000'000'123'456'000);
  EXPECT_EQ(sample.gyro_imu, Eigen::Vector3d(0.1F, -0.25, -0.3F));
  EXPECT_EQ(sample.accel_imu, Eigen::Vector3d(1, -2, 9.8125)) << "at rest it points upwards";
}

TEST(OnboardMessages, AnAutopilotsImuThatMeasuresNothingIsRefused) {
  EXPECT_EQ(reason(decode_px4_imu(px4_imu_bytes(0.25F, 0x7fffffff))), "no specific force");
  EXPECT_EQ(reason(decode_px4_imu(px4_imu_bytes(std::numeric_limits<float>::quiet_NaN()))),
            "value not finite");
  Bytes late = px4_imu_bytes(0.25F);
  std::fill_n(late.begin() + 4, 8, 0xff);
  EXPECT_EQ(reason(decode_px4_imu(late)), "no valid stamp");
}

TEST(OnboardMessages, SensorsComeBackAsTheyWere) {
  CameraImage image{kStamp_ns, 2, 1, 2, {1, 2, 3, 4}};
  const auto image_again = decode_image(encode(image));
  ASSERT_EQ(reason(image_again), "accepted");
  EXPECT_EQ(std::get<CameraImage>(image_again).pixels, image.pixels);
  EXPECT_EQ(std::get<CameraImage>(image_again).stamp_ns, kStamp_ns);
  EXPECT_EQ(std::get<CameraImage>(image_again).bytes_per_pixel, 2);
  const ImuSample sample{kStamp_ns, {0.1, -0.2, 0.3}, {1, 2, -9.81}};
  const auto sample_again = decode_imu(encode(sample));
  ASSERT_EQ(reason(sample_again), "accepted");
  EXPECT_EQ(std::get<ImuSample>(sample_again).stamp_ns, kStamp_ns);
  EXPECT_EQ(std::get<ImuSample>(sample_again).gyro_imu, sample.gyro_imu);
  EXPECT_EQ(std::get<ImuSample>(sample_again).accel_imu, sample.accel_imu);
  const auto from_px4 = decode_px4_imu(encode_px4_imu(sample));
  ASSERT_EQ(reason(from_px4), "accepted");
  EXPECT_EQ(std::get<ImuSample>(from_px4).stamp_ns, kStamp_ns / 1000 * 1000) << "microseconds";
  EXPECT_LT((std::get<ImuSample>(from_px4).gyro_imu - sample.gyro_imu).norm(), 1e-6);
  EXPECT_LT((std::get<ImuSample>(from_px4).accel_imu - sample.accel_imu).norm(), 1e-5);
}

TEST(OnboardMessages, WhatIsNoImageIsRefusedWithItsReason) {
  const auto refused = [](auto change) {
    ImageFields fields;
    change(fields);
    return reason(decode_image(image_bytes(fields)));
  };
  EXPECT_EQ(refused([](ImageFields& f) { f.encoding = "jpeg"; }),
            std::string("encoding is none of ") + kReadableEncodings);
  EXPECT_EQ(refused([](ImageFields& f) { f.encoding = "yuyv"; }), "rows of an image overlap");
  EXPECT_EQ(refused([](ImageFields& f) { f.encoding = "bgr8"; }), "rows of an image overlap");
  EXPECT_EQ(refused([](ImageFields& f) { f.width = 0; }), "image without pixels");
  EXPECT_EQ(refused([](ImageFields& f) { f.height = 0; }), "image without pixels");
  EXPECT_EQ(refused([](ImageFields& f) { f.width = f.step = 20'000; }), "image too large");
  EXPECT_EQ(refused([](ImageFields& f) { f.step = 2; }), "rows of an image overlap");
  EXPECT_EQ(refused([](ImageFields& f) { f.data.pop_back(); }), "image cut short");
  // A step so large that its product with the height does not fit into 32 bits.
  EXPECT_EQ(refused([](ImageFields& f) { f.step = 0x80000000; }), "image cut short");
}

TEST(OnboardMessages, StampsThatAreNoneAreRefused) {
  EXPECT_EQ(reason(decode_imu(imu_bytes(0.1, 1'000'000'000))), "no valid stamp");
  const Bytes before_1970 = CdrBytes()
                                .header(-1, 0)
                                .put(std::uint32_t{1})
                                .put(std::uint32_t{1})
                                .text("mono8")
                                .put(std::uint8_t{0})
                                .put(std::uint32_t{1})
                                .octets({7})
                                .bytes();
  EXPECT_EQ(reason(decode_image(before_1970)), "no valid stamp");
}

TEST(OnboardMessages, AStampThatCannotBeSaidIsSaidToBeNone) {
  constexpr TimeNs kRosEnd_ns = 2'147'483'648'000'000'000;  // January 2038
  ImuSample sample{kRosEnd_ns - 1, {0.1, -0.2, 0.3}, {1, 2, -9.81}};
  const auto latest = decode_imu(encode(sample));
  ASSERT_EQ(reason(latest), "accepted");
  EXPECT_EQ(std::get<ImuSample>(latest).stamp_ns, sample.stamp_ns);
  // Cut to 32 bits the third would be 7 ns after 1970 began.
  for (const TimeNs none : {TimeNs{-1}, kRosEnd_ns, 2 * kRosEnd_ns + 7, -2 * kRosEnd_ns + 7}) {
    sample.stamp_ns = none;
    EXPECT_EQ(reason(decode_imu(encode(sample))), "no valid stamp") << none;
  }
  sample.stamp_ns = -5000;
  EXPECT_EQ(reason(decode_px4_imu(encode_px4_imu(sample))), "no valid stamp");
  BodyMotion before;
  before.odometry.stamp_ns = -5000;
  before.odometry.pose.q_world_imu.setIdentity();
  const Bytes told = encode_px4_odometry(before, Eigen::Quaterniond::Identity());
  EXPECT_EQ(read<Px4Odometry>(told).timestamp(), 0U);
}

TEST(OnboardMessages, AnImuSampleThatIsNotFiniteIsRefused) {
  EXPECT_EQ(reason(decode_imu(imu_bytes(std::numeric_limits<double>::quiet_NaN()))),
            "value not finite");
  EXPECT_EQ(reason(decode_imu(imu_bytes(std::numeric_limits<double>::infinity()))),
            "value not finite");
}

TEST(OnboardMessages, WhatEndsTooEarlyOrGoesOnIsRefused) {
  const Bytes image = image_bytes({}), imu = imu_bytes(0.1), px4_imu = px4_imu_bytes(0.1F);
  for (std::size_t size = 0; size < px4_imu.size(); ++size)
    EXPECT_NE(
        reason(decode_px4_imu(Bytes(px4_imu.begin(), px4_imu.begin() + static_cast<long>(size)))),
        "accepted");
  for (std::size_t size = 0; size < image.size(); ++size)
    EXPECT_NE(reason(decode_image(Bytes(image.begin(), image.begin() + static_cast<long>(size)))),
              "accepted");
  for (std::size_t size = 0; size < imu.size(); ++size)
    EXPECT_NE(reason(decode_imu(Bytes(imu.begin(), imu.begin() + static_cast<long>(size)))),
              "accepted");
  Bytes longer = image;
  longer.resize(longer.size() + 4);
  EXPECT_EQ(reason(decode_image(longer)), "sample has bytes left over");
}

// Nothing of the claimed size is allocated: this would need four gigabytes.
TEST(OnboardMessages, ALengthThatLiesIsRefused) {
  Bytes image = image_bytes({});
  const std::size_t length_at = image.size() - 6 - 4;
  std::fill_n(image.begin() + static_cast<long>(length_at), 4, 0xff);
  EXPECT_EQ(reason(decode_image(image)), "sample ends too early");
}

TEST(OnboardMessages, AnyBytesAreReadOrRefused) {
  std::mt19937 random(7);
  const Bytes image = image_bytes({}), imu = imu_bytes(0.1);
  for (int i = 0; i < 20'000; ++i) {
    Bytes bytes = i % 2 == 0 ? image : imu;
    for (int change = 0; change < 3; ++change)
      bytes[random() % bytes.size()] = static_cast<std::uint8_t>(random());
    (void)decode_image(bytes);
    (void)decode_imu(bytes);
    (void)decode_px4_imu(bytes);
  }
}

BodyMotion motion() {
  BodyMotion out;
  out.odometry = samples::odometry();
  out.odometry.stamp_ns = kStamp_ns;
  out.odometry.status = FilterStatus::kTracking;
  out.odometry.pose.q_world_imu = exp_quaternion({0.3, -0.4, 1.2});
  out.gyro_imu = {0.5, 0.6, 0.7};
  out.restarts = 3;
  return out;
}

TEST(OnboardMessages, NavOdometryHasVelocitiesInTheBodysAxes) {
  const BodyMotion flown = motion();
  const Pose& pose = flown.odometry.pose;
  const auto told = read<NavOdometry>(encode_nav_odometry(flown, "world", "uav0/imu"));
  EXPECT_EQ(told.header().stamp().sec(), 1'700'000'000);
  EXPECT_EQ(told.header().stamp().nanosec(), 123'456'789U);
  EXPECT_EQ(told.header().frame_id(), "world");
  EXPECT_EQ(told.child_frame_id(), "uav0/imu");
  EXPECT_EQ(told.pose().pose().position().x(), pose.p_world_imu.x());
  EXPECT_EQ(told.pose().pose().orientation().w(), pose.q_world_imu.w());
  const auto& linear = told.twist().twist().linear();
  EXPECT_TRUE((pose.q_world_imu * Eigen::Vector3d(linear.x(), linear.y(), linear.z()))
                  .isApprox(flown.odometry.v_world_imu, 1e-12));
  EXPECT_EQ(told.twist().twist().angular().z(), 0.7);
}

TEST(OnboardMessages, NavOdometryHasTheVelocitysCovarianceInTheBodysAxes) {
  BodyMotion flown = motion();
  flown.odometry.velocity_covariance = Eigen::Vector3d(1, 4, 9).asDiagonal();
  const auto told = read<NavOdometry>(encode_nav_odometry(flown, "world", "imu"));
  const Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> covariance(
      told.twist().covariance().data());
  const Eigen::Vector3d along_body(0.2, -0.5, 0.8);
  const Eigen::Vector3d along_world = flown.odometry.pose.q_world_imu * along_body;
  EXPECT_NEAR(along_body.dot(covariance.topLeftCorner<3, 3>() * along_body),
              along_world.dot(flown.odometry.velocity_covariance * along_world), 1e-12);
  EXPECT_TRUE(covariance.rightCols<3>().isZero());
}

// Monte Carlo: local rotation errors as the filter has them, seen as turns about the world's axes.
TEST(OnboardMessages, NavOdometrysCovarianceIsAboutTheWorldsAxes) {
  BodyMotion flown = motion();
  Matrix6d factor = Matrix6d::Zero();
  factor.diagonal() << 0.1, 0.2, 0.3, 0.01, 0.02, 0.03;
  factor(3, 0) = 0.004;
  flown.odometry.pose_covariance = factor * factor.transpose();
  const auto told = read<NavOdometry>(encode_nav_odometry(flown, "world", "imu"));
  const Eigen::Map<const Eigen::Matrix<double, 6, 6, Eigen::RowMajor>> claimed(
      told.pose().covariance().data());

  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  const Eigen::Quaterniond& q = flown.odometry.pose.q_world_imu;
  Matrix6d drawn = Matrix6d::Zero();
  constexpr int kDraws = 20'000;
  for (int i = 0; i < kDraws; ++i) {
    Vector6d error;
    for (int k = 0; k < 6; ++k) error[k] = normal(random);
    error = factor * error;
    const Eigen::Quaterniond wrong = q * exp_quaternion(error.tail<3>());
    error.tail<3>() = log_quaternion(wrong * q.conjugate());
    drawn += error * error.transpose() / kDraws;
  }
  EXPECT_LT((drawn - claimed).norm(), 0.03 * claimed.norm());
  EXPECT_LT((drawn - claimed).bottomRightCorner(3, 3).norm(),
            0.03 * claimed.bottomRightCorner(3, 3).norm());
}

// Vectors, not formulas: what the body's axes and the world's say of one and the same arrow.
TEST(OnboardMessages, Px4sAxesPointForwardRightAndDown) {
  const BodyMotion flown = motion();
  const Pose& pose = flown.odometry.pose;
  const Eigen::Quaterniond q_body_imu = exp_quaternion({0.2, 1.3, -0.4});
  const auto told = read<Px4Odometry>(encode_px4_odometry(flown, q_body_imu));
  EXPECT_EQ(told.timestamp_sample(), 1'700'000'000'123'456U);
  EXPECT_EQ(told.pose_frame(), 2);
  EXPECT_EQ(told.velocity_frame(), 2);
  EXPECT_EQ(told.reset_counter(), 3);

  const auto in_px4 = [](const Eigen::Vector3d& v) {
    return Eigen::Vector3d(v.x(), -v.y(), -v.z());
  };
  const Eigen::Quaternionf q(told.q()[0], told.q()[1], told.q()[2], told.q()[3]);
  for (const Eigen::Vector3d& arrow_imu :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0.1, 0.2, -0.9)}) {
    const Eigen::Vector3d arrow_body = in_px4(q_body_imu * arrow_imu);
    const Eigen::Vector3d arrow_world = in_px4(pose.q_world_imu * arrow_imu);
    EXPECT_LT((q.cast<double>() * arrow_body - arrow_world).norm(), 1e-6);
  }
  EXPECT_NEAR(told.position()[1], -pose.p_world_imu.y(), 1e-6);
  EXPECT_NEAR(told.velocity()[2], -flown.odometry.v_world_imu.z(), 1e-6);
  const Eigen::Vector3d gyro_body = in_px4(q_body_imu * flown.gyro_imu);
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(told.angular_velocity()[static_cast<std::size_t>(i)], gyro_body[i], 1e-6);
}

TEST(OnboardMessages, Px4IsToldVariancesInTheBodysAxes) {
  BodyMotion flown = motion();
  const Vector6d variances = (Vector6d() << 1, 2, 3, 0.1, 0.2, 0.3).finished();
  flown.odometry.pose_covariance = variances.asDiagonal();
  flown.odometry.velocity_covariance = Eigen::Vector3d(4, 5, 6).asDiagonal();
  const Eigen::Quaterniond quarter_left(Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ()));
  const auto told = read<Px4Odometry>(encode_px4_odometry(flown, quarter_left));
  EXPECT_THAT(told.position_variance(), ElementsAre(1, 2, 3));
  EXPECT_NEAR(told.orientation_variance()[0], 0.2, 1e-6);  // the IMU's y axis points backwards
  EXPECT_NEAR(told.orientation_variance()[1], 0.1, 1e-6);
  EXPECT_NEAR(told.orientation_variance()[2], 0.3, 1e-6);
  EXPECT_THAT(told.velocity_variance(), ElementsAre(4, 5, 6));
}

// Level, heading a quarter to the left: PX4's yaw grows to the right.
TEST(OnboardMessages, ATurnToTheLeftIsANegativeYawOfPx4) {
  BodyMotion flown = motion();
  flown.odometry.pose.q_world_imu = Eigen::AngleAxisd(M_PI / 2, Eigen::Vector3d::UnitZ());
  const auto told = read<Px4Odometry>(encode_px4_odometry(flown, Eigen::Quaterniond::Identity()));
  EXPECT_NEAR(2 * std::atan2(told.q()[3], told.q()[0]), -M_PI / 2, 1e-6);
}

TEST(OnboardMessages, Px4IsToldHowGoodItIs) {
  BodyMotion flown = motion();
  const auto quality = [&flown](FilterStatus status) {
    flown.odometry.status = status;
    return read<Px4Odometry>(encode_px4_odometry(flown, Eigen::Quaterniond::Identity())).quality();
  };
  EXPECT_EQ(quality(FilterStatus::kTracking), 100);
  EXPECT_EQ(quality(FilterStatus::kDegraded), 1);
}

}  // namespace
}  // namespace covey
