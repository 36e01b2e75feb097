// SPDX-License-Identifier: Apache-2.0
//
// What a drone hears from its own camera and IMU and says to its own autopilot, over DDS, in the
// words of ROS 2 and PX4: no ROS is needed for it.
//
//   topic (ROS 2 name)                       type
//   image_topic      camera/image_raw        sensor_msgs/Image, as image_pixels.h reads it
//   imu_topic        imu/data_raw            sensor_msgs/Imu, specific force with gravity
//     or             fmu/out/sensor_combined             px4_msgs/SensorCombined, the autopilot's
//   odometry_topic   odometry                nav_msgs/Odometry, at every image or more often
//   px4_topic        fmu/in/vehicle_visual_odometry      px4_msgs/VehicleOdometry, likewise
//
// Stamps of both sensors are of one clock. What comes in is put out in the order of its stamps, as
// far as those can be believed (stamp_order.h), and waits in bounded queues that drop their oldest.
// All members may be called from any thread.
#pragma once

#include <Eigen/Core>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "comms/onboard_messages.h"
#include "comms/stamp_order.h"

namespace covey {

enum class ImuMessage { kRos, kPx4 };

struct OnboardConfig {
  int domain = 0;             // ROS_DOMAIN_ID, 0..200
  bool loopback_only = true;  // this computer's programs alone; otherwise all, by multicast
  // Lost samples are asked for again; drivers that offer best effort alone are then not heard.
  bool reliable = false;
  std::string image_topic = "camera/image_raw";
  std::string imu_topic = "imu/data_raw";
  ImuMessage imu_message = ImuMessage::kRos;
  // At every image; or, if this is not 0, up to so often, at the newest IMU sample.
  double odometry_rate_hz = 0;
  std::string odometry_topic = "odometry";  // empty: not told
  std::string px4_topic;                    // empty: not told
  // How the IMU is mounted in PX4's body (forward, left, up): roll, pitch, yaw, rad;
  // R_body_imu = Rz(yaw) Ry(pitch) Rx(roll).
  Eigen::Vector3d imu_mount_rpy = Eigen::Vector3d::Zero();
  std::size_t image_queue = 4;
  std::size_t imu_queue = 20'000;  // nobody takes them for 20 s, at 1 kHz
};

// Since the start.
struct OnboardCounts {
  std::uint64_t images = 0, imu_samples = 0;          // received
  std::uint64_t images_dropped = 0, imu_dropped = 0;  // queue full
  std::uint64_t refused = 0;                          // malformed samples
  std::string last_refusal;                           // topic and reason
  StampCounts image_stamps, imu_stamps;               // left out for their stamps
  std::uint64_t malformed_packets = 0;                // stopped before DDS saw them
};

class OnboardLink {
 public:
  // `frame` and `child_frame`: of the odometry, the world and the IMU. Throws std::runtime_error
  // that says what to do.
  OnboardLink(const OnboardConfig& config, std::string frame, std::string child_frame);
  ~OnboardLink();
  OnboardLink(const OnboardLink&) = delete;
  OnboardLink& operator=(const OnboardLink&) = delete;

  // The oldest that waits; nothing if none comes within `patience`.
  [[nodiscard]] std::optional<CameraImage> next_image(std::chrono::milliseconds patience);
  [[nodiscard]] std::vector<ImuSample> take_imu();
  // True once a sample later than `stamp_ns` has come.
  [[nodiscard]] bool wait_for_imu(TimeNs stamp_ns, std::chrono::milliseconds patience);

  void publish(const BodyMotion& motion);

  [[nodiscard]] OnboardCounts counts() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace covey
