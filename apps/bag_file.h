// SPDX-License-Identifier: Apache-2.0
//
// One file of a recording of ROS: serialised messages. Every function throws std::runtime_error
// that names the file.
#pragma once

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "apps/bag.h"
#include "comms/convert.h"

namespace covey {

using TakeMessage = std::function<void(const Bytes&)>;

class BagFile {
 public:
  BagFile() = default;
  virtual ~BagFile() = default;
  BagFile(const BagFile&) = delete;
  BagFile& operator=(const BagFile&) = delete;

  // Those of which messages can be read. Types by ROS 2's names.
  [[nodiscard]] virtual std::vector<BagTopic> topics() const = 0;
  [[nodiscard]] virtual std::int64_t begin_ns() const = 0;  // of the recording; 0: empty
  // As ROS 1 serialised them, not as they went over DDS.
  [[nodiscard]] virtual bool of_ros1() const { return false; }
  // All messages of a topic in the order in which they were recorded.
  virtual void read(const std::string& topic, const TakeMessage& take) const = 0;
};

[[nodiscard]] std::unique_ptr<BagFile> open_sqlite_bag(const std::filesystem::path& file);
[[nodiscard]] std::unique_ptr<BagFile> open_mcap_bag(const std::filesystem::path& file);
[[nodiscard]] std::unique_ptr<BagFile> open_ros1_bag(const std::filesystem::path& file);

// Of a file that can only be read from its beginning to its end.
struct RecordedMessage {
  BagTopic topic;
  std::int64_t stamp_ns = 0;
  Bytes data;
};

struct BagContents {
  std::vector<BagTopic> topics;  // by name
  std::int64_t begin_ns = 0;
};

// `read_all`: gives each message to the function that it is given.
template <typename ReadAll>
BagContents contents_of(const ReadAll& read_all) {
  std::map<std::string, BagTopic> by_name;
  std::int64_t begin_ns = std::numeric_limits<std::int64_t>::max();
  read_all([&](const RecordedMessage& message) {
    ++by_name.try_emplace(message.topic.name, message.topic).first->second.messages;
    begin_ns = std::min(begin_ns, message.stamp_ns);
  });
  BagContents contents;
  if (!by_name.empty()) contents.begin_ns = begin_ns;
  for (auto& [name, topic] : by_name) contents.topics.push_back(std::move(topic));
  return contents;
}

}  // namespace covey
