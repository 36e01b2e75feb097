// SPDX-License-Identifier: Apache-2.0
//
// Messages of ROS 2 and PX4 (idl/onboard.idl) to plain structs and back: what a drone's sensors say
// to Covey, and what Covey says to the rest of the drone. Decoders refuse what is malformed, as
// those of convert.h do.
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "comms/convert.h"
#include "estimator/measurements.h"

namespace covey {

// Largest samples that are sent or accepted, bytes.
inline constexpr std::size_t kMaxImageBytes = std::size_t{32} << 20;
inline constexpr std::size_t kMaxImuBytes = 1024;
inline constexpr std::size_t kPx4ImuBytes = 64;
inline constexpr std::size_t kMaxNavOdometryBytes = 1024;
inline constexpr std::size_t kPx4OdometryBytes = 128;

// Grey, row after row without gaps; 16 bits in the byte order of this machine. Of colours it is
// what they weigh in brightness (ITU-R BT.601).
struct CameraImage {
  TimeNs stamp_ns = 0;
  int width = 0, height = 0;
  int bytes_per_pixel = 1;  // 1 or 2
  std::vector<std::uint8_t> pixels;
};

// sensor_msgs/Image, as ROS 1 and ROS 2 have it.
struct RosImage {
  TimeNs stamp_ns = 0;
  std::uint32_t width = 0, height = 0;  // pixels
  std::uint32_t step = 0;               // bytes from row to row
  std::string encoding;                 // "mono8"; what else is read stands in image_pixels.h
  bool is_big_endian = false;
  std::vector<std::uint8_t> data;
};

// sensor_msgs/CompressedImage: a file of JPEG or PNG, which apps/packed_image.h unpacks.
struct PackedImage {
  TimeNs stamp_ns = 0;
  std::string format;  // "jpeg", "bayer_rggb8; png compressed "
  std::vector<std::uint8_t> file;
};

// How the drone moves, for the other programs on board.
struct BodyMotion {
  Odometry odometry;
  Eigen::Vector3d gyro_imu = Eigen::Vector3d::Zero();  // rad/s, bias taken out
  std::uint8_t restarts = 0;  // how often the filter has begun anew: positions may have jumped
};

// sensor_msgs/Image: sent as mono8 or mono16.
// sensor_msgs/Imu: without orientation.
[[nodiscard]] Bytes encode(const CameraImage& image);
[[nodiscard]] Bytes encode(const ImuSample& sample);
[[nodiscard]] Decoded<CameraImage> decode_image(const Bytes& bytes);
[[nodiscard]] Decoded<ImuSample> decode_imu(const Bytes& bytes);
[[nodiscard]] Decoded<PackedImage> decode_packed_image(const Bytes& bytes);
// What both decoders do with a message once it is read.
[[nodiscard]] Decoded<CameraImage> checked(RosImage image);
[[nodiscard]] Decoded<PackedImage> checked(PackedImage image);
[[nodiscard]] Decoded<ImuSample> checked(const ImuSample& sample);

// px4_msgs/SensorCombined: the autopilot's own IMU. The sample's axes are forward, left, up of the
// body.
[[nodiscard]] Bytes encode_px4_imu(const ImuSample& sample);
[[nodiscard]] Decoded<ImuSample> decode_px4_imu(const Bytes& bytes);

// nav_msgs/Odometry of `child_frame`, the IMU, in `frame`, the world. The covariance of the linear
// velocity is the world's, seen along the IMU's axes; of the angular velocity none is told.
[[nodiscard]] Bytes encode_nav_odometry(const BodyMotion& motion, const std::string& frame,
                                        const std::string& child_frame);

// px4_msgs/VehicleOdometry. PX4's axes are forward, right, down: of the world, whose heading is
// any, and of the body. `q_body_imu` takes vectors from the IMU's axes to those of the body as
// forward, left, up. The position stays the IMU's.
[[nodiscard]] Bytes encode_px4_odometry(const BodyMotion& motion,
                                        const Eigen::Quaterniond& q_body_imu);

}  // namespace covey
