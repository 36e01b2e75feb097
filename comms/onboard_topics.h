// SPDX-License-Identifier: Apache-2.0
//
// Which type goes with which topic aboard, as idl/onboard.idl has them.
#pragma once

#include <string>

#include "comms/onboard_link.h"
#include "comms/onboard_messages.h"
#include "comms/onboard_participant.h"

namespace covey {

inline OnboardTopic image_topic(const std::string& topic) {
  return {topic, "sensor_msgs::msg::dds_::Image_", kMaxImageBytes};
}
inline OnboardTopic imu_topic(const std::string& topic, ImuMessage message) {
  if (message == ImuMessage::kPx4)
    return {topic, "px4_msgs::msg::dds_::SensorCombined_", kPx4ImuBytes};
  return {topic, "sensor_msgs::msg::dds_::Imu_", kMaxImuBytes};
}
inline OnboardTopic nav_odometry_topic(const std::string& topic) {
  return {topic, "nav_msgs::msg::dds_::Odometry_", kMaxNavOdometryBytes};
}
inline OnboardTopic px4_odometry_topic(const std::string& topic) {
  return {topic, "px4_msgs::msg::dds_::VehicleOdometry_", kPx4OdometryBytes};
}

}  // namespace covey
