// SPDX-License-Identifier: Apache-2.0
#include "apps/link_record.h"

#include <algorithm>
#include <exception>
#include <nlohmann/json.hpp>

#include "apps/json_file.h"
#include "comms/checks.h"

namespace covey {

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(KindStatistics, sent, received, refused, payload_bytes_sent,
                                   payload_bytes_received)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LinkStatistics, request, message, status, odometry,
                                   messages_sent_to, rejected, refused, dropped, inbox_dropped,
                                   dds_errors, last_dds_error, wire_bytes_sent, wire_bytes_received,
                                   unseen_port, missing_network, restarts, process_cpu_ms,
                                   process_peak_kib)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LinkReport, statistics, peers)
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(ClockOffset, offset_ns, round_trip_ns)

namespace {

using Json = nlohmann::json;

constexpr std::size_t kMaxWaitingBytes = 4 * kMaxFullMessageBytes;
constexpr std::size_t kMaxJsonBytes = 1 << 20;
constexpr std::size_t kMaxComplaintBytes = 4096;
constexpr std::size_t kMaxErrorBytes = 512;

Bytes header(RecordKind kind, std::size_t size) {
  Bytes out = {'c', 'v', kRecordVersion, static_cast<std::uint8_t>(kind)};
  for (int shift = 0; shift < 32; shift += 8)
    out.push_back(static_cast<std::uint8_t>(size >> shift));
  return out;
}

std::size_t length_in(const std::uint8_t* header) {
  std::size_t length = 0;
  for (std::size_t i = 0; i < 4; ++i) length |= std::size_t{header[4 + i]} << (8 * i);
  return length;
}

Problem problem_with_header(const std::uint8_t* header) {
  if (header[0] != 'c' || header[1] != 'v') return "no record";
  if (header[2] != kRecordVersion) return "record of another version";
  if (header[3] > static_cast<std::uint8_t>(RecordKind::kOdometry)) return "unknown kind of record";
  if (length_in(header) > max_content(static_cast<RecordKind>(header[3]))) return "record too long";
  return {};
}

void erase_front(Bytes& buffer, std::size_t& used) {
  buffer.erase(buffer.begin(), buffer.begin() + static_cast<std::ptrdiff_t>(used));
  used = 0;
}

// Refused as soon as it has too many levels: what follows calls itself for each of them.
Decoded<Json> json_in(const Bytes& content) {
  bool too_deep = false;
  const auto look = [&](int depth, Json::parse_event_t, const Json&) {
    too_deep = too_deep || depth > kMostJsonLevels;
    return !too_deep;  // else it is not kept
  };
  Json json = Json::parse(content.begin(), content.end(), look, false);
  if (too_deep) return Rejected{"report is nested too deep"};
  if (json.is_discarded()) return Rejected{"report is not JSON"};
  return json;
}

// A number that is none of ours, such as -1 or 1e300, would be cut to something else.
bool holds_counts_and_texts(const Json& json) {
  if (!json.is_structured()) return json.is_number_unsigned() || json.is_string();
  return std::all_of(json.begin(), json.end(), holds_counts_and_texts);
}

// Of which some may be negative.
bool holds_times(const Json& json) {
  if (json.is_structured()) return std::all_of(json.begin(), json.end(), holds_times);
  if (json.is_number_unsigned()) return json.get<std::uint64_t>() <= std::uint64_t{kMaxStampNs};
  return json.is_number_integer();
}

bool is_clock_of_a_drone(const std::pair<const std::string, ClockOffset>& clock) {
  const auto& [name, offset] = clock;
  return is_agent_name(name) && offset.offset_ns >= -kMaxStampNs &&
         offset.offset_ns <= kMaxStampNs && is_stamp(offset.round_trip_ns);
}

}  // namespace

std::size_t max_content(RecordKind kind) {
  switch (kind) {
    case RecordKind::kSettings:
    case RecordKind::kReport:
      return kMaxJsonBytes;
    case RecordKind::kComplaint:
      return kMaxComplaintBytes;
    case RecordKind::kRequest:
      return kMaxRequestBytes;
    case RecordKind::kMessage:
      return kMaxMessageBytes;
    case RecordKind::kFullMessage:
      return kMaxFullMessageBytes;
    case RecordKind::kStatus:
      return kMaxStatusBytes;
    case RecordKind::kOdometry:
      break;
  }
  return kMaxOdometryBytes;
}

// ---------------------------------------------------------------------------------- the stream

void RecordReader::append(const std::uint8_t* bytes, std::size_t size) {
  erase_front(buffer_, read_);
  buffer_.insert(buffer_.end(), bytes, bytes + size);
}

std::optional<Decoded<Record>> RecordReader::next() {
  const std::size_t left = buffer_.size() - read_;
  if (left < kRecordHeaderBytes) return std::nullopt;
  const std::uint8_t* start = buffer_.data() + read_;
  if (const Problem problem = problem_with_header(start)) return Rejected{*problem};
  const std::size_t size = kRecordHeaderBytes + length_in(start);
  if (left < size) return std::nullopt;
  read_ += size;
  return Record{static_cast<RecordKind>(start[3]), Bytes(start + kRecordHeaderBytes, start + size)};
}

bool RecordWriter::offer(RecordKind kind, const Bytes& content) {
  const bool room = size() + kRecordHeaderBytes + content.size() <= kMaxWaitingBytes;
  if (!room || content.size() > max_content(kind)) return false;
  erase_front(buffer_, written_);
  const Bytes first = header(kind, content.size());
  buffer_.insert(buffer_.end(), first.begin(), first.end());
  buffer_.insert(buffer_.end(), content.begin(), content.end());
  return true;
}

void RecordWriter::drop(std::size_t bytes) { written_ += std::min(bytes, size()); }

// ------------------------------------------------------------------------------------ contents

Bytes encode(const LinkReport& report) {
  LinkReport short_report = report;
  std::string& error = short_report.statistics.last_dds_error;
  error.resize(std::min(error.size(), kMaxErrorBytes));
  std::string& missing = short_report.statistics.missing_network;
  missing.resize(std::min(missing.size(), kMaxErrorBytes));
  Json json = short_report;
  json["clocks"] = report.statistics.clocks;  // apart from the counts, which are never negative
  // What DDS says of hostile packets need not be UTF-8.
  return to_bytes(printable(json));
}

Decoded<LinkReport> decode_link_report(const Bytes& content) {
  Decoded<Json> decoded = json_in(content);
  if (const auto* rejected = std::get_if<Rejected>(&decoded)) return *rejected;
  Json& json = std::get<Json>(decoded);
  const Json clocks = json.is_object() ? json.value("clocks", Json()) : Json();
  if (json.is_object()) json.erase("clocks");
  if (!holds_counts_and_texts(json)) return Rejected{"report holds something else than counts"};
  try {
    LinkReport report = json.get<LinkReport>();
    if (!std::all_of(report.peers.begin(), report.peers.end(), is_agent_name))
      return Rejected{"report of a peer that is not a drone's name"};
    if (!clocks.is_object() || !holds_times(clocks))
      return Rejected{"report of clocks that are none"};
    auto& of_drones = report.statistics.clocks = clocks.get<std::map<std::string, ClockOffset>>();
    if (!std::all_of(of_drones.begin(), of_drones.end(), is_clock_of_a_drone))
      return Rejected{"report of clocks that are none"};
    return report;
  } catch (const std::exception&) {
    return Rejected{"report of another form"};
  }
}

Bytes to_bytes(const std::string& text) { return {text.begin(), text.end()}; }

std::string to_text(const Bytes& content) { return {content.begin(), content.end()}; }

}  // namespace covey
