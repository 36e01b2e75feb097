// SPDX-License-Identifier: Apache-2.0
//
// A recording of `ros2 bag record`, whichever way it is stored and over however many files.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "apps/bag_file.h"

namespace covey {

class Ros2Bag {
 public:
  // A .db3 or .mcap file, or the folder that holds those of one recording. Throws
  // std::runtime_error that names the file and what to do about it, as read() does.
  explicit Ros2Bag(const std::filesystem::path& bag);

  [[nodiscard]] const std::vector<BagTopic>& topics() const { return topics_; }  // by name

  // All messages of a topic in the order in which they were recorded.
  void read(const std::string& topic, const TakeMessage& take) const;

 private:
  std::vector<std::unique_ptr<BagFile>> files_;  // in the order of their recording
  std::vector<BagTopic> topics_;
};

}  // namespace covey
