// SPDX-License-Identifier: Apache-2.0
#include "apps/bag.h"

#include <cstdint>
#include <map>
#include <stdexcept>
#include <utility>
#include <variant>

#include "apps/bag_file.h"
#include "apps/packed_image.h"
#include "comms/ros1_messages.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

bool is_bag_file(const fs::path& file) {
  const fs::path kind = file.extension();
  return kind == ".db3" || kind == ".mcap" || kind == ".bag";
}

std::unique_ptr<BagFile> open(const fs::path& file) {
  if (file.extension() == ".bag") return open_ros1_bag(file);
  if (file.extension() == ".mcap") return open_mcap_bag(file);
  return open_sqlite_bag(file);
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
  if (files.empty()) throw std::runtime_error(bag.string() + ": holds no .db3, .mcap or .bag file");
  return files;
}

Decoded<CameraImage> decode_packed(bool of_ros1, const Bytes& message) {
  const auto decoded = of_ros1 ? decode_ros1_packed_image(message) : decode_packed_image(message);
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) return *rejected;
  return unpacked(std::get<PackedImage>(decoded));
}

Decoded<CameraImage> decode_picture(bool of_ros1, const std::string& type, const Bytes& message) {
  if (type == kPackedImageType) return decode_packed(of_ros1, message);
  return of_ros1 ? decode_ros1_image(message) : decode_image(message);
}

Decoded<ImuSample> decode_sample(bool of_ros1, const std::string& type, const Bytes& message) {
  if (of_ros1) return decode_ros1_imu(message);
  return type == kPx4ImuType ? decode_px4_imu(message) : decode_imu(message);
}

}  // namespace

Bag::Bag(const fs::path& bag) {
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

Bag::~Bag() = default;

void Bag::read_images(const BagTopic& topic, const TakeImage& take) const {
  for (const std::unique_ptr<BagFile>& file : files_) {
    const bool of_ros1 = file->of_ros1();
    file->read(topic.name,
               [&](const Bytes& message) { take(decode_picture(of_ros1, topic.type, message)); });
  }
}

void Bag::read_imu(const BagTopic& topic, const TakeSample& take) const {
  for (const std::unique_ptr<BagFile>& file : files_) {
    const bool of_ros1 = file->of_ros1();
    file->read(topic.name,
               [&](const Bytes& message) { take(decode_sample(of_ros1, topic.type, message)); });
  }
}

}  // namespace covey
