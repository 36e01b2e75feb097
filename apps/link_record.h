// SPDX-License-Identifier: Apache-2.0
//
// What a drone's process and the process of its link say to each other:
//
//   drone -> link   settings; then requests, messages, status and odometry to be sent
//   link -> drone   a report, ten times a second; requests, messages and status that arrived;
//                   a complaint before it gives up
//
// Samples are encoded as on the wire (comms/convert.h), settings and reports are JSON, a complaint
// is text. Each record is a header of 8 bytes, 'c' 'v' version kind and the length of the content
// (little-endian), followed by the content. The link's process reads what strangers send and may
// one day be theirs: what it says is checked as a stranger's words are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "comms/convert.h"
#include "comms/link.h"

namespace covey {

inline constexpr std::uint8_t kRecordVersion = 2;
inline constexpr std::size_t kRecordHeaderBytes = 8;

enum class RecordKind : std::uint8_t {
  kSettings,
  kReport,
  kComplaint,
  kRequest,
  kMessage,
  kFullMessage,
  kStatus,
  kOdometry,
};

// Longest content, bytes.
[[nodiscard]] std::size_t max_content(RecordKind kind);

struct Record {
  RecordKind kind = RecordKind::kReport;
  Bytes content;
};

// Records out of a stream that is cut anywhere. Holds no more than one record and what was given
// at once.
class RecordReader {
 public:
  void append(const std::uint8_t* bytes, std::size_t size);
  // The next whole record; nothing while it is incomplete. Rejected: no records, to the end of the
  // stream.
  [[nodiscard]] std::optional<Decoded<Record>> next();

 private:
  Bytes buffer_;
  std::size_t read_ = 0;  // bytes of the buffer
};

// Records that wait to become a stream.
class RecordWriter {
 public:
  // False: so much is waiting already that there is no room.
  [[nodiscard]] bool offer(RecordKind kind, const Bytes& content);

  [[nodiscard]] const std::uint8_t* data() const { return buffer_.data() + written_; }
  [[nodiscard]] std::size_t size() const { return buffer_.size() - written_; }
  void drop(std::size_t bytes);  // which have been written

 private:
  Bytes buffer_;
  std::size_t written_ = 0;  // bytes of the buffer
};

struct LinkReport {
  LinkStatistics statistics;
  std::set<std::string> peers;
};

[[nodiscard]] Bytes encode(const LinkReport& report);
[[nodiscard]] Decoded<LinkReport> decode_link_report(const Bytes& content);

[[nodiscard]] Bytes to_bytes(const std::string& text);
[[nodiscard]] std::string to_text(const Bytes& content);

}  // namespace covey
