// SPDX-License-Identifier: Apache-2.0
//
// Messages of ROS 1, serialised by its own library, and what is refused.
#include "comms/ros1_messages.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ros/serialization.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>

#include <limits>

namespace covey {
namespace {

using testing::ElementsAre;

constexpr TimeNs kStamp_ns = 1'700'000'000'123'456'789;

template <typename Message>
Bytes serialised(const Message& message) {
  Bytes bytes(ros::serialization::serializationLength(message));
  ros::serialization::OStream stream(bytes.data(), static_cast<std::uint32_t>(bytes.size()));
  ros::serialization::serialize(stream, message);
  return bytes;
}

sensor_msgs::Image image_of(const std::string& encoding, std::uint32_t step,
                            std::vector<std::uint8_t> data) {
  sensor_msgs::Image image;
  image.header.stamp.fromNSec(kStamp_ns);
  image.header.frame_id = "camera";
  image.width = 2;
  image.height = 2;
  image.encoding = encoding;
  image.step = step;
  image.data = std::move(data);
  return image;
}

sensor_msgs::CompressedImage packed_image() {
  sensor_msgs::CompressedImage image;
  image.header.stamp.fromNSec(kStamp_ns);
  image.format = "mono8; png compressed ";
  image.data = {1, 2, 3};
  return image;
}

sensor_msgs::Imu imu() {
  sensor_msgs::Imu sample;
  sample.header.stamp.fromNSec(kStamp_ns);
  sample.orientation.w = 1;
  sample.angular_velocity.x = 0.1;
  sample.angular_velocity.y = 0.2;
  sample.angular_velocity.z = 0.3;
  sample.linear_acceleration.x = 1;
  sample.linear_acceleration.y = 2;
  sample.linear_acceleration.z = 9.81;
  return sample;
}

template <typename Message>
std::string rejected(const Decoded<Message>& decoded) {
  const auto* reason = std::get_if<Rejected>(&decoded);
  return reason != nullptr ? reason->reason : "";
}

TEST(Ros1Messages, AnImageIsReadAsItWasSaid) {
  const Bytes bytes = serialised(image_of("mono8", 3, {1, 2, 0, 3, 4, 0}));
  const auto image = std::get<CameraImage>(decode_ros1_image(bytes));
  EXPECT_EQ(image.stamp_ns, kStamp_ns);
  EXPECT_EQ(image.width, 2);
  EXPECT_EQ(image.height, 2);
  EXPECT_EQ(image.bytes_per_pixel, 1);
  EXPECT_THAT(image.pixels, ElementsAre(1, 2, 3, 4));
}

TEST(Ros1Messages, SixteenBitsOfEitherOrder) {
  sensor_msgs::Image image = image_of("mono16", 4, {0, 1, 0, 2, 0, 3, 0, 4});
  image.is_bigendian = 1;
  const auto decoded = std::get<CameraImage>(decode_ros1_image(serialised(image)));
  EXPECT_EQ(decoded.bytes_per_pixel, 2);
  EXPECT_THAT(decoded.pixels, ElementsAre(1, 0, 2, 0, 3, 0, 4, 0)) << "of this machine's order";
}

TEST(Ros1Messages, APackedImageIsReadAsItWasSaid) {
  const auto image = std::get<PackedImage>(decode_ros1_packed_image(serialised(packed_image())));
  EXPECT_EQ(image.stamp_ns, kStamp_ns);
  EXPECT_EQ(image.format, "mono8; png compressed ");
  EXPECT_THAT(image.file, ElementsAre(1, 2, 3));
}

TEST(Ros1Messages, AnImuSampleIsReadAsItWasSaid) {
  const auto sample = std::get<ImuSample>(decode_ros1_imu(serialised(imu())));
  EXPECT_EQ(sample.stamp_ns, kStamp_ns);
  EXPECT_EQ(sample.gyro_imu, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(sample.accel_imu, Eigen::Vector3d(1, 2, 9.81));
}

TEST(Ros1Messages, WhatIsCutShortOrTooLongIsRefused) {
  const Bytes image = serialised(image_of("mono8", 2, {1, 2, 3, 4}));
  const Bytes sample = serialised(imu());
  for (std::size_t size = 0; size < image.size(); ++size) {
    EXPECT_EQ(rejected(decode_ros1_image({image.begin(), image.begin() + static_cast<long>(size)})),
              "sample ends too early");
  }
  for (std::size_t size = 0; size < sample.size(); ++size) {
    EXPECT_EQ(rejected(decode_ros1_imu({sample.begin(), sample.begin() + static_cast<long>(size)})),
              "sample ends too early");
  }
  const Bytes packed = serialised(packed_image());
  for (std::size_t size = 0; size < packed.size(); ++size) {
    const Bytes begin(packed.begin(), packed.begin() + static_cast<long>(size));
    EXPECT_EQ(rejected(decode_ros1_packed_image(begin)), "sample ends too early");
  }
  Bytes longer = sample;
  longer.push_back(0);
  EXPECT_EQ(rejected(decode_ros1_imu(longer)), "sample has bytes left over");
}

TEST(Ros1Messages, WhatMakesNoSenseIsRefused) {
  EXPECT_THAT(rejected(decode_ros1_image(serialised(image_of("jpeg", 2, {1, 2, 3, 4})))),
              testing::HasSubstr("encoding is none of"));
  EXPECT_EQ(rejected(decode_ros1_image(serialised(image_of("mono8", 2, {1, 2, 3})))),
            "image cut short");
  sensor_msgs::CompressedImage depths = packed_image();
  depths.format = "16UC1; compressedDepth png";
  EXPECT_EQ(rejected(decode_ros1_packed_image(serialised(depths))), "depths instead of brightness");
  sensor_msgs::Imu sample = imu();
  sample.angular_velocity.x = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(rejected(decode_ros1_imu(serialised(sample))), "value not finite");
  sample = imu();
  sample.header.stamp = ros::Time();
  EXPECT_EQ(rejected(decode_ros1_imu(serialised(sample))), "no valid stamp");
}

}  // namespace
}  // namespace covey
