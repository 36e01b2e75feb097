// SPDX-License-Identifier: Apache-2.0
//
// One file of a recording of `ros2 bag record`: serialised messages, as they went over DDS. Every
// function throws std::runtime_error that names the file.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "comms/convert.h"

namespace covey {

struct BagTopic {
  std::string name;          // "/camera/image_raw"
  std::string type;          // "sensor_msgs/msg/Image"
  std::size_t messages = 0;  // recorded
};

using TakeMessage = std::function<void(const Bytes&)>;

class BagFile {
 public:
  BagFile() = default;
  virtual ~BagFile() = default;
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  [[nodiscard]] virtual std::vector<BagTopic> topics() const = 0;  // of CDR messages
  [[nodiscard]] virtual std::int64_t begin_ns() const = 0;         // of the recording; 0: empty
  // All messages of a topic in the order in which they were recorded.
  virtual void read(const std::string& topic, const TakeMessage& take) const = 0;
};

[[nodiscard]] std::unique_ptr<BagFile> open_sqlite_bag(const std::filesystem::path& file);
[[nodiscard]] std::unique_ptr<BagFile> open_mcap_bag(const std::filesystem::path& file);

}  // namespace covey
