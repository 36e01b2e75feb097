// SPDX-License-Identifier: Apache-2.0
//
// Messages as ROS 1 serialised them, which only recordings hold. Decoders refuse what is malformed,
// as those of onboard_messages.h do.
#pragma once

#include "comms/convert.h"
#include "comms/onboard_messages.h"
#include "estimator/measurements.h"

namespace covey {

// sensor_msgs/Image, sensor_msgs/CompressedImage, sensor_msgs/Imu.
[[nodiscard]] Decoded<CameraImage> decode_ros1_image(const Bytes& bytes);
[[nodiscard]] Decoded<PackedImage> decode_ros1_packed_image(const Bytes& bytes);
[[nodiscard]] Decoded<ImuSample> decode_ros1_imu(const Bytes& bytes);

}  // namespace covey
