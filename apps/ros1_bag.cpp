// SPDX-License-Identifier: Apache-2.0
//
// Format 2.0 of ROS 1's rosbag (https://wiki.ros.org/Bags/Format/2.0): records of a header, which
// is a list of name=value, and data, each after its length; most of them in chunks, which may be
// compressed. Indices are not needed, so a recording that was cut short is read as far as it goes.
// Debian's library for it would bring Python's interpreter aboard every drone.
#include <cstdint>
#include <fstream>
#include <map>
#include <optional>
#include <stdexcept>
#include <utility>

#include "apps/bag_chunk.h"
#include "apps/bag_file.h"
#include "comms/byte_fields.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

constexpr char kMagic[] = "#ROSBAG V2.0\n";
constexpr std::uint32_t kMaxPart = std::uint32_t{1} << 30U;  // bytes

enum Kind : std::uint8_t { kMessage = 2, kBagHeader = 3, kChunk = 5, kConnection = 7 };

using Header = std::map<std::string, Bytes>;

struct Record {
  Header header;
  Bytes data;
};

Header header_of(const Bytes& bytes) {
  ByteFields fields(bytes);
  Header header;
  while (!fields.at_end()) {
    const std::string field = fields.text();
    const std::size_t equals = field.find('=');
    if (equals == std::string::npos) throw Unreadable("header without names");
    header[field.substr(0, equals)] = {field.begin() + static_cast<std::ptrdiff_t>(equals) + 1,
                                       field.end()};
  }
  return header;
}

const Bytes& value_of(const Header& header, const std::string& name) {
  const auto value = header.find(name);
  if (value == header.end()) throw Unreadable("header without " + name);
  return value->second;
}

template <typename Unsigned>
Unsigned number_of(const Header& header, const std::string& name) {
  return ByteFields(value_of(header, name)).number<Unsigned>();
}

std::string text_of(const Header& header, const std::string& name) {
  const Bytes& value = value_of(header, name);
  return {value.begin(), value.end()};
}

// "sensor_msgs/Image" is "sensor_msgs/msg/Image" since.
std::string ros2_name(std::string type) {
  const std::size_t slash = type.find('/');
  if (slash != std::string::npos) type.insert(slash, "/msg");
  return type;
}

std::int64_t stamp_of(const Header& header) {
  ByteFields time(value_of(header, "time"));
  const auto seconds = std::int64_t{time.number<std::uint32_t>()};
  return seconds * 1'000'000'000 + std::int64_t{time.number<std::uint32_t>()};
}

// None at the end, or where the file was cut short.
std::optional<Bytes> next_part(std::istream& in) {
  Bytes length(sizeof(std::uint32_t));
  if (!in.read(reinterpret_cast<char*>(length.data()), sizeof(std::uint32_t))) return std::nullopt;
  const auto size = ByteFields(length).number<std::uint32_t>();
  if (size > kMaxPart) throw Unreadable("record too large");
  Bytes part(size);
  if (!in.read(reinterpret_cast<char*>(part.data()), size)) return std::nullopt;
  return part;
}

std::optional<Record> next_record(std::istream& in) {
  const std::optional<Bytes> header = next_part(in);
  std::optional<Bytes> data;
  if (header) data = next_part(in);
  if (!data) return std::nullopt;
  return Record{header_of(*header), std::move(*data)};
}

// Keeps in mind what connections carry.
class MessageReader {
 public:
  void read(Record record, const TakeRecorded& take) {
    switch (number_of<std::uint8_t>(record.header, "op")) {
      case kBagHeader:
        require_plain(record.header);
        return;
      case kConnection:
        topics_[number_of<std::uint32_t>(record.header, "conn")] = {
            text_of(record.header, "topic"), ros2_name(text_of(header_of(record.data), "type")), 0};
        return;
      case kMessage: {
        const auto topic = topics_.find(number_of<std::uint32_t>(record.header, "conn"));
        if (topic != topics_.end())
          take(RecordedMessage{topic->second, stamp_of(record.header), std::move(record.data)});
        return;
      }
      case kChunk:
        if (is_in_chunk_) throw Unreadable("chunk in a chunk");
        read_chunk(record, take);
        return;
      default:
        return;
    }
  }

 private:
  static void require_plain(const Header& header) {
    const auto encryptor = header.find("encryptor");
    if (encryptor != header.end() && !encryptor->second.empty())
      throw Unreadable("encrypted by " + text_of(header, "encryptor"));
  }

  void read_chunk(const Record& chunk, const TakeRecorded& take) {
    const Bytes records = unpacked(text_of(chunk.header, "compression"), chunk.data,
                                   number_of<std::uint32_t>(chunk.header, "size"));
    is_in_chunk_ = true;
    ByteFields fields(records);
    while (!fields.at_end()) {
      const auto header_size = fields.number<std::uint32_t>();
      const Bytes header = fields.bytes(header_size);
      const auto data_size = fields.number<std::uint32_t>();
      read(Record{header_of(header), fields.bytes(data_size)}, take);
    }
    is_in_chunk_ = false;
  }

  std::map<std::uint32_t, BagTopic> topics_;  // by connection
  bool is_in_chunk_ = false;
};

[[noreturn]] void fail(const fs::path& file, const std::string& why) {
  throw std::runtime_error(file.string() + ": no bag of ROS 1 that can be read: " + why);
}

void read_all(const fs::path& file, const TakeRecorded& take) {
  std::ifstream in(file, std::ios::binary);
  std::string magic(sizeof(kMagic) - 1, ' ');
  if (!in.read(magic.data(), static_cast<std::streamsize>(magic.size())) || magic != kMagic)
    fail(file, "another beginning");
  MessageReader reader;
  try {
    while (std::optional<Record> record = next_record(in)) reader.read(std::move(*record), take);
  } catch (const Unreadable& error) {
    fail(file, error.what());
  }
}

}  // namespace

std::unique_ptr<BagFile> open_ros1_bag(const fs::path& file) {
  return std::make_unique<StreamedBag>(true,
                                       [file](const TakeRecorded& take) { read_all(file, take); });
}

}  // namespace covey
