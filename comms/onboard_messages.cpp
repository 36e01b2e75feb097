// SPDX-License-Identifier: Apache-2.0
#include "comms/onboard_messages.h"

#include <algorithm>
#include <array>
#include <limits>
#include <optional>
#include <utility>

#include "comms/cdr.h"
#include "comms/checks.h"
#include "comms/image_pixels.h"
#include "idl/onboard.h"

namespace covey {
namespace {

namespace ros_time = builtin_interfaces::msg::dds_;
namespace ros_std = std_msgs::msg::dds_;
namespace ros_geometry = geometry_msgs::msg::dds_;
namespace ros_sensors = sensor_msgs::msg::dds_;
namespace ros_nav = nav_msgs::msg::dds_;
namespace px4 = px4_msgs::msg::dds_;

constexpr TimeNs kSecond_ns = 1'000'000'000;
// ROS 2 counts seconds in 32 bits: until January 2038.
constexpr TimeNs kRosEnd_ns = (TimeNs{std::numeric_limits<std::int32_t>::max()} + 1) * kSecond_ns;
constexpr std::uint32_t kMaxSide = 16384;  // pixels

// 0, which nobody stamps with, for what ROS 2 cannot say.
ros_std::Header_ header(TimeNs stamp_ns, const std::string& frame) {
  const TimeNs told_ns = stamp_ns >= 0 && stamp_ns < kRosEnd_ns ? stamp_ns : 0;
  ros_std::Header_ out;
  out.stamp().sec(static_cast<std::int32_t>(told_ns / kSecond_ns));
  out.stamp().nanosec(static_cast<std::uint32_t>(told_ns % kSecond_ns));
  out.frame_id(frame);
  return out;
}

// PX4 counts microseconds; 0 for what is no stamp.
std::uint64_t px4_time(TimeNs stamp_ns) {
  return static_cast<std::uint64_t>(std::max<TimeNs>(stamp_ns, 0) / 1000);
}

// 0, which nobody stamps with, for what is none.
TimeNs stamp_of(const ros_std::Header_& header) {
  const ros_time::Time_& stamp = header.stamp();
  if (stamp.sec() < 0 || stamp.nanosec() >= kSecond_ns) return 0;
  return stamp.sec() * kSecond_ns + static_cast<TimeNs>(stamp.nanosec());
}

template <typename Vector>
Vector ros_vector(const Eigen::Vector3d& v) {
  Vector out;
  out.x(v.x());
  out.y(v.y());
  out.z(v.z());
  return out;
}

Eigen::Vector3d plain(const ros_geometry::Vector3_& v) { return {v.x(), v.y(), v.z()}; }

ros_geometry::Quaternion_ ros_quaternion(const Eigen::Quaterniond& q) {
  ros_geometry::Quaternion_ out;
  out.x(q.x());
  out.y(q.y());
  out.z(q.z());
  out.w(q.w());
  return out;
}

Problem problem_with(const RosImage& image) {
  const std::optional<PixelFormat> format = pixel_format(image.encoding);
  if (!format) return std::string("encoding is none of ") + kReadableEncodings;
  if (image.width == 0 || image.height == 0) return "image without pixels";
  if (image.width > kMaxSide || image.height > kMaxSide) return "image too large";
  if (image.step < image.width * format->bytes) return "rows of an image overlap";
  if (image.data.size() < std::size_t{image.step} * image.height) return "image cut short";
  if (!is_stamp(image.stamp_ns) || image.stamp_ns == 0) return "no valid stamp";
  return {};
}

// Of position in world, and of rotation about the world's axes: that of a local error, turned.
std::array<double, 36> fixed_axes_covariance(const Odometry& odometry) {
  Matrix6d turn = Matrix6d::Identity();
  turn.bottomRightCorner<3, 3>() = odometry.pose.q_world_imu.toRotationMatrix();
  std::array<double, 36> out{};
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(out.data()) =
      turn * odometry.pose_covariance * turn.transpose();
  return out;
}

// Of the velocity along the IMU's axes; how uncertain these are in the world is left out.
std::array<double, 36> body_velocity_covariance(const Odometry& odometry) {
  const Eigen::Matrix3d R_world_imu = odometry.pose.q_world_imu.toRotationMatrix();
  std::array<double, 36> out{};
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(out.data()).topLeftCorner<3, 3>() =
      R_world_imu.transpose() * odometry.velocity_covariance * R_world_imu;
  return out;
}

// Forward-left-up to forward-right-down and back: half a turn about the x axis.
Eigen::Vector3d flipped(const Eigen::Vector3d& v) { return {v.x(), -v.y(), -v.z()}; }
Eigen::Quaterniond flipped(const Eigen::Quaterniond& q) { return {q.w(), q.x(), -q.y(), -q.z()}; }

std::array<float, 3> floats(const Eigen::Vector3d& v) {
  return {static_cast<float>(v.x()), static_cast<float>(v.y()), static_cast<float>(v.z())};
}

Eigen::Vector3d plain(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

// Per cent; 0 would mean that nothing is known of it.
char px4_quality(FilterStatus status) { return status == FilterStatus::kTracking ? 100 : 1; }

}  // namespace

Bytes encode(const CameraImage& image) {
  ros_sensors::Image_ out;
  out.header(header(image.stamp_ns, "cam0"));
  out.height(static_cast<std::uint32_t>(image.height));
  out.width(static_cast<std::uint32_t>(image.width));
  out.encoding(image.bytes_per_pixel == 1 ? "mono8" : "mono16");
  out.is_bigendian(is_big_endian_machine() ? 1 : 0);
  out.step(static_cast<std::uint32_t>(image.width * image.bytes_per_pixel));
  out.data(image.pixels);
  return to_cdr(out);
}

Bytes encode(const ImuSample& sample) {
  ros_sensors::Imu_ out;
  out.header(header(sample.stamp_ns, "imu0"));
  out.orientation().w(1);
  out.orientation_covariance()[0] = -1;
  out.angular_velocity(ros_vector<ros_geometry::Vector3_>(sample.gyro_imu));
  out.linear_acceleration(ros_vector<ros_geometry::Vector3_>(sample.accel_imu));
  return to_cdr(out);
}

Decoded<CameraImage> checked(RosImage image) {
  if (const Problem problem = problem_with(image)) return Rejected{*problem};
  CameraImage out;
  out.stamp_ns = image.stamp_ns;
  out.width = static_cast<int>(image.width);
  out.height = static_cast<int>(image.height);
  const PixelFormat format = *pixel_format(image.encoding);
  const PixelRows rows{image.width, image.height, image.step, image.is_big_endian};
  out.bytes_per_pixel =
      format.kind == PixelFormat::Kind::kGrey ? static_cast<int>(format.bytes) : 1;
  out.pixels = grey_pixels(format, rows, std::move(image.data));
  return out;
}

Decoded<PackedImage> checked(PackedImage image) {
  if (!is_stamp(image.stamp_ns) || image.stamp_ns == 0) return Rejected{"no valid stamp"};
  if (image.format.find("compressedDepth") != std::string::npos)
    return Rejected{"depths instead of brightness"};
  return image;
}

Decoded<ImuSample> checked(const ImuSample& sample) {
  if (!is_stamp(sample.stamp_ns) || sample.stamp_ns == 0) return Rejected{"no valid stamp"};
  if (!sample.gyro_imu.allFinite() || !sample.accel_imu.allFinite())
    return Rejected{"value not finite"};
  return sample;
}

Decoded<CameraImage> decode_image(const Bytes& bytes) {
  if (const Problem problem = problem_with_cdr(bytes, kMaxImageBytes)) return Rejected{*problem};
  auto decoded = from_cdr<ros_sensors::Image_>(bytes);
  if (auto* rejected = std::get_if<Rejected>(&decoded)) return std::move(*rejected);
  auto& image = std::get<ros_sensors::Image_>(decoded);
  return checked(RosImage{stamp_of(image.header()), image.width(), image.height(), image.step(),
                          image.encoding(), image.is_bigendian() != 0, std::move(image.data())});
}

Decoded<PackedImage> decode_packed_image(const Bytes& bytes) {
  if (const Problem problem = problem_with_cdr(bytes, kMaxImageBytes)) return Rejected{*problem};
  auto decoded = from_cdr<ros_sensors::CompressedImage_>(bytes);
  if (auto* rejected = std::get_if<Rejected>(&decoded)) return std::move(*rejected);
  auto& image = std::get<ros_sensors::CompressedImage_>(decoded);
  return checked(PackedImage{stamp_of(image.header()), image.format(), std::move(image.data())});
}

Decoded<ImuSample> decode_imu(const Bytes& bytes) {
  if (const Problem problem = problem_with_cdr(bytes, kMaxImuBytes)) return Rejected{*problem};
  const auto decoded = from_cdr<ros_sensors::Imu_>(bytes);
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) return *rejected;
  const auto& imu = std::get<ros_sensors::Imu_>(decoded);
  return checked(ImuSample{stamp_of(imu.header()), plain(imu.angular_velocity()),
                           plain(imu.linear_acceleration())});
}

Bytes encode_px4_imu(const ImuSample& sample) {
  px4::SensorCombined_ out;
  out.timestamp(px4_time(sample.stamp_ns));
  out.gyro_rad(floats(flipped(sample.gyro_imu)));
  out.accelerometer_m_s2(floats(flipped(sample.accel_imu)));
  return to_cdr(out);
}

Decoded<ImuSample> decode_px4_imu(const Bytes& bytes) {
  constexpr std::int32_t kNone = 0x7fffffff;
  if (const Problem problem = problem_with_cdr(bytes, kPx4ImuBytes)) return Rejected{*problem};
  const auto decoded = from_cdr<px4::SensorCombined_>(bytes);
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) return *rejected;
  const auto& imu = std::get<px4::SensorCombined_>(decoded);
  if (imu.accelerometer_timestamp_relative() == kNone) return Rejected{"no specific force"};
  if (imu.timestamp() > std::uint64_t{kMaxStampNs / 1000}) return Rejected{"no valid stamp"};
  return checked(ImuSample{static_cast<TimeNs>(imu.timestamp()) * 1000,
                           flipped(plain(imu.gyro_rad())),
                           flipped(plain(imu.accelerometer_m_s2()))});
}

Bytes encode_nav_odometry(const BodyMotion& motion, const std::string& frame,
                          const std::string& child_frame) {
  const Odometry& odometry = motion.odometry;
  const Eigen::Quaterniond& q_world_imu = odometry.pose.q_world_imu;
  ros_nav::Odometry_ out;
  out.header(header(odometry.stamp_ns, frame));
  out.child_frame_id(child_frame);
  out.pose().pose().position(ros_vector<ros_geometry::Point_>(odometry.pose.p_world_imu));
  out.pose().pose().orientation(ros_quaternion(q_world_imu));
  out.pose().covariance(fixed_axes_covariance(odometry));
  out.twist().twist().linear(
      ros_vector<ros_geometry::Vector3_>(q_world_imu.inverse() * odometry.v_world_imu));
  out.twist().twist().angular(ros_vector<ros_geometry::Vector3_>(motion.gyro_imu));
  out.twist().covariance(body_velocity_covariance(odometry));
  return to_cdr(out);
}

Bytes encode_px4_odometry(const BodyMotion& motion, const Eigen::Quaterniond& q_body_imu) {
  constexpr std::uint8_t kForwardRightDown = 2;
  const Odometry& odometry = motion.odometry;
  const Eigen::Quaterniond q_world_body =
      flipped(odometry.pose.q_world_imu * q_body_imu.conjugate()).normalized();
  const Eigen::Matrix3d R_body_imu = q_body_imu.toRotationMatrix();
  const Eigen::Matrix3d attitude_covariance =
      R_body_imu * odometry.pose_covariance.bottomRightCorner<3, 3>() * R_body_imu.transpose();
  px4::VehicleOdometry_ out;
  out.timestamp(px4_time(odometry.stamp_ns));
  out.timestamp_sample(out.timestamp());
  out.pose_frame(kForwardRightDown);
  out.position(floats(flipped(odometry.pose.p_world_imu)));
  out.q({static_cast<float>(q_world_body.w()), static_cast<float>(q_world_body.x()),
         static_cast<float>(q_world_body.y()), static_cast<float>(q_world_body.z())});
  out.velocity_frame(kForwardRightDown);
  out.velocity(floats(flipped(odometry.v_world_imu)));
  out.angular_velocity(floats(flipped(R_body_imu * motion.gyro_imu)));
  out.position_variance(floats(odometry.pose_covariance.diagonal().head<3>()));
  out.orientation_variance(floats(attitude_covariance.diagonal()));
  out.velocity_variance(floats(odometry.velocity_covariance.diagonal()));
  out.reset_counter(motion.restarts);
  out.quality(px4_quality(odometry.status));
  return to_cdr(out);
}

}  // namespace covey
