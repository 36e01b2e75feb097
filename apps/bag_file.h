// SPDX-License-Identifier: Apache-2.0
//
// One file of a recording of ROS: serialised messages. Every function throws std::runtime_error
// that names the file.
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
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

struct RecordedMessage {
  BagTopic topic;
  std::int64_t stamp_ns = 0;
  Bytes data;
};
using TakeRecorded = std::function<void(const RecordedMessage&)>;

// A file that can only be read from its beginning to its end.
class StreamedBag final : public BagFile {
 public:
  using ReadAll = std::function<void(const TakeRecorded&)>;
  StreamedBag(bool of_ros1, ReadAll read_all);

  [[nodiscard]] std::vector<BagTopic> topics() const override { return topics_; }
  [[nodiscard]] std::int64_t begin_ns() const override { return begin_ns_; }
  [[nodiscard]] bool of_ros1() const override { return of_ros1_; }
  void read(const std::string& topic, const TakeMessage& take) const override;

 private:
  bool of_ros1_;
  ReadAll read_all_;
  std::vector<BagTopic> topics_;  // by name
  std::int64_t begin_ns_ = 0;
};

}  // namespace covey
