// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>
#include <utility>

#include "apps/bag_file.h"

namespace covey {

StreamedBag::StreamedBag(bool of_ros1, ReadAll read_all)
    : of_ros1_(of_ros1), read_all_(std::move(read_all)) {
  std::map<std::string, BagTopic> by_name;
  read_all_([&](const RecordedMessage& message) {
    begin_ns_ = by_name.empty() ? message.stamp_ns : std::min(begin_ns_, message.stamp_ns);
    ++by_name.try_emplace(message.topic.name, message.topic).first->second.messages;
  });
  for (auto& [name, topic] : by_name) topics_.push_back(std::move(topic));
}

void StreamedBag::read(const std::string& topic, const TakeMessage& take) const {
  read_all_([&](const RecordedMessage& message) {
    if (message.topic.name == topic) take(message.data);
  });
}

}  // namespace covey
