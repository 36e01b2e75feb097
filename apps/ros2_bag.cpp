// SPDX-License-Identifier: Apache-2.0
#include "apps/ros2_bag.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <stdexcept>
#include <utility>

namespace covey {
namespace {

namespace fs = std::filesystem;

bool is_bag_file(const fs::path& file) {
  return file.extension() == ".db3" || file.extension() == ".mcap";
}

std::unique_ptr<BagFile> open(const fs::path& file) {
  return file.extension() == ".mcap" ? open_mcap_bag(file) : open_sqlite_bag(file);
}

std::vector<fs::path> files_of(const fs::path& bag) {
  if (!fs::exists(bag)) throw std::runtime_error(bag.string() + ": does not exist");
  if (!fs::is_directory(bag)) return {bag};
  std::vector<fs::path> files;
  for (const fs::directory_entry& entry : fs::directory_iterator(bag)) {
    const fs::path& file = entry.path();
    if (is_bag_file(file)) files.push_back(file);
    if (file.extension() == ".zstd" && is_bag_file(file.stem()))
      throw std::runtime_error(file.string() + ": is compressed: unpack it with zstd -d");
  }
  if (files.empty()) throw std::runtime_error(bag.string() + ": holds no .db3 or .mcap file");
  return files;
}

}  // namespace

Ros2Bag::Ros2Bag(const fs::path& bag) {
  std::multimap<std::int64_t, std::unique_ptr<BagFile>> by_begin;
  for (const fs::path& path : files_of(bag)) {
    std::unique_ptr<BagFile> file = open(path);
    const std::int64_t begin_ns = file->begin_ns();
    by_begin.emplace(begin_ns, std::move(file));
  }
  std::map<std::string, BagTopic> by_name;
  for (auto& [begin_ns, file] : by_begin) {
    for (const BagTopic& part : file->topics()) {
      BagTopic& topic =
          by_name.try_emplace(part.name, BagTopic{part.name, part.type, 0}).first->second;
      topic.messages += part.messages;
    }
    files_.push_back(std::move(file));
  }
  for (auto& [name, topic] : by_name) topics_.push_back(std::move(topic));
}

void Ros2Bag::read(const std::string& topic, const TakeMessage& take) const {
  for (const std::unique_ptr<BagFile>& file : files_) file->read(topic, take);
}

}  // namespace covey
