// SPDX-License-Identifier: Apache-2.0
//
// Storage mcap of rosbag2 (https://mcap.dev/spec): records of a kind, a length and that many bytes,
// little-endian; most of them in chunks, which may be compressed. Indices and summaries are not
// needed, so a recording that was cut short is read as far as it goes.
#include <array>
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

constexpr std::array<char, 8> kMagic = {'\x89', 'M', 'C', 'A', 'P', '0', '\r', '\n'};
constexpr std::uint64_t kMaxRecord = std::uint64_t{1} << 30U;  // bytes

enum Kind : std::uint8_t { kSchema = 3, kChannel = 4, kMessage = 5, kChunk = 6, kDataEnd = 15 };

struct Record {
  std::uint8_t kind = 0;
  Bytes content;
};

// Keeps in mind what channels carry. Those of other encodings than CDR are left out.
class MessageReader {
 public:
  std::optional<RecordedMessage> read(const Record& record) {
    ByteFields fields(record.content);
    switch (record.kind) {
      case kSchema: {
        const auto id = fields.number<std::uint16_t>();
        types_[id] = fields.text();
        return std::nullopt;
      }
      case kChannel: {
        const auto id = fields.number<std::uint16_t>();
        const auto schema = fields.number<std::uint16_t>();
        const std::string topic = fields.text();
        if (fields.text() == "cdr") topics_[id] = {topic, types_[schema], 0};
        return std::nullopt;
      }
      case kMessage: {
        const auto topic = topics_.find(fields.number<std::uint16_t>());
        if (topic == topics_.end()) return std::nullopt;
        (void)fields.number<std::uint32_t>();  // how many before it
        const auto stamp_ns = static_cast<std::int64_t>(fields.number<std::uint64_t>());
        (void)fields.number<std::uint64_t>();  // when it was said
        return RecordedMessage{topic->second, stamp_ns, fields.rest()};
      }
      default:
        return std::nullopt;
    }
  }

 private:
  std::map<std::uint16_t, std::string> types_;  // by schema
  std::map<std::uint16_t, BagTopic> topics_;    // by channel
};

void read_one(const Record& record, MessageReader& reader, const TakeRecorded& take) {
  const std::optional<RecordedMessage> message = reader.read(record);
  if (message) take(*message);
}

void read_chunk(const Bytes& content, MessageReader& reader, const TakeRecorded& take) {
  ByteFields chunk(content);
  (void)chunk.number<std::uint64_t>();  // first and last stamp
  (void)chunk.number<std::uint64_t>();
  const auto size = chunk.number<std::uint64_t>();
  (void)chunk.number<std::uint32_t>();  // checksum
  const std::string compression = chunk.text();
  const auto packed_size = chunk.number<std::uint64_t>();
  const Bytes records = unpacked(compression, chunk.bytes(packed_size), size);
  ByteFields fields(records);
  while (!fields.at_end()) {
    Record record;
    record.kind = fields.number<std::uint8_t>();
    const auto record_size = fields.number<std::uint64_t>();
    record.content = fields.bytes(record_size);
    read_one(record, reader, take);
  }
}

// None at the end, or where the file was cut short.
std::optional<Record> next(std::ifstream& in) {
  Bytes head(1 + sizeof(std::uint64_t));
  if (!in.read(reinterpret_cast<char*>(head.data()), static_cast<std::streamsize>(head.size())))
    return std::nullopt;
  ByteFields fields(head);
  Record record;
  record.kind = fields.number<std::uint8_t>();
  const auto size = fields.number<std::uint64_t>();
  if (size > kMaxRecord) throw Unreadable("record too large");
  record.content.resize(size);
  if (!in.read(reinterpret_cast<char*>(record.content.data()), static_cast<std::streamsize>(size)))
    return std::nullopt;
  return record;
}

[[noreturn]] void fail(const fs::path& file, const std::string& why) {
  throw std::runtime_error(file.string() + ": no MCAP file that can be read: " + why);
}

void read_all(const fs::path& file, const TakeRecorded& take) {
  std::ifstream in(file, std::ios::binary);
  std::array<char, kMagic.size()> magic{};
  if (!in.read(magic.data(), magic.size()) || magic != kMagic) fail(file, "another beginning");
  MessageReader reader;
  try {
    while (const std::optional<Record> record = next(in)) {
      if (record->kind == kDataEnd) return;
      if (record->kind == kChunk)
        read_chunk(record->content, reader, take);
      else
        read_one(*record, reader, take);
    }
  } catch (const Unreadable& error) {
    fail(file, error.what());
  }
}

}  // namespace

std::unique_ptr<BagFile> open_mcap_bag(const fs::path& file) {
  return std::make_unique<StreamedBag>(false,
                                       [file](const TakeRecorded& take) { read_all(file, take); });
}

}  // namespace covey
