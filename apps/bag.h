// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "comms/convert.h"
#include "comms/onboard_messages.h"
#include "estimator/measurements.h"

namespace covey {

class BagFile;

inline constexpr const char* kImageType = "sensor_msgs/msg/Image";
inline constexpr const char* kPackedImageType = "sensor_msgs/msg/CompressedImage";
inline constexpr const char* kImuType = "sensor_msgs/msg/Imu";
inline constexpr const char* kPx4ImuType = "px4_msgs/msg/SensorCombined";

struct BagTopic {
  std::string name;          // "/camera/image_raw"
  std::string type;          // "sensor_msgs/msg/Image"
  std::size_t messages = 0;  // recorded
};

using TakeImage = std::function<void(Decoded<CameraImage>)>;
using TakeSample = std::function<void(const Decoded<ImuSample>&)>;

// A recording of `ros2 bag record` or of ROS 1's `rosbag record`, whichever way it is stored and
// over however many files.
class Bag {
 public:
  // A .db3, .mcap or .bag file, or the folder that holds those of one recording. Throws
  // std::runtime_error that names the file and what to do about it, as reading does.
  explicit Bag(const std::filesystem::path& bag);
  ~Bag();

  [[nodiscard]] const std::vector<BagTopic>& topics() const { return topics_; }  // by name

  // All messages of a topic in the order in which they were recorded.
  void read_images(const BagTopic& topic, const TakeImage& take) const;
  void read_imu(const BagTopic& topic, const TakeSample& take) const;

 private:
  std::vector<std::unique_ptr<BagFile>> files_;  // in the order of their recording
  std::vector<BagTopic> topics_;
};

}  // namespace covey
