// SPDX-License-Identifier: Apache-2.0
//
// The stream that a drone reads from its link's process, under libFuzzer: cut into two pieces, as
// a socket may, and every record's content decoded as the drone does.
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <variant>

#include "apps/link_record.h"

namespace {

// What was accepted must be fit to be reported, and to be understood, again.
void check_report(const covey::Bytes& content) {
  const auto decoded = covey::decode_link_report(content);
  const auto* report = std::get_if<covey::LinkReport>(&decoded);
  if (report == nullptr) return;
  const auto again = covey::decode_link_report(encode(*report));
  const auto* same = std::get_if<covey::LinkReport>(&again);
  if (same == nullptr || same->peers != report->peers) std::abort();
  (void)sum(report->statistics, same->statistics);
}

void check(const covey::Record& record) {
  if (record.content.size() > max_content(record.kind)) std::abort();
  switch (record.kind) {
    case covey::RecordKind::kReport:
      return check_report(record.content);
    case covey::RecordKind::kRequest:
      return (void)covey::decode_place_advert(record.content);
    case covey::RecordKind::kMessage:
      return (void)covey::decode_peer_keyframe(record.content);
    case covey::RecordKind::kFullMessage:
      return (void)covey::decode_full_keyframe(record.content);
    case covey::RecordKind::kStatus:
      return (void)covey::decode_status(record.content);
    case covey::RecordKind::kSettings:
    case covey::RecordKind::kComplaint:
    case covey::RecordKind::kOdometry:
      return;
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::size_t cut = size == 0 ? 0 : data[size - 1] % size;
  covey::RecordReader reader;
  const covey::Bytes bytes(data, data + size);
  for (const auto& [from, to] : {std::pair(std::size_t{0}, cut), std::pair(cut, size)}) {
    reader.append(bytes.data() + from, to - from);
    while (const auto next = reader.next()) {
      if (std::holds_alternative<covey::Rejected>(*next)) return 0;
      check(std::get<covey::Record>(*next));
    }
  }
  return 0;
}
