// SPDX-License-Identifier: Apache-2.0
#include "comms/link.h"

#include <algorithm>
#include <utility>

namespace covey {
namespace {

constexpr std::size_t kMaxNames = 300;
constexpr char kOthers[] = "others";

template <typename Value>
Value& value_of(const std::string& name, std::map<std::string, Value>& values) {
  const bool room = values.size() < kMaxNames || values.count(name) > 0;
  return values[room ? name : kOthers];
}

void add(KindStatistics& sum, const KindStatistics& more) {
  sum.sent += more.sent;
  sum.received += more.received;
  sum.refused += more.refused;
  sum.payload_bytes_sent += more.payload_bytes_sent;
  sum.payload_bytes_received += more.payload_bytes_received;
}

void add(std::uint64_t& sum, std::uint64_t more) { sum += more; }

template <typename Value>
void add(std::map<std::string, Value>& sum, const std::map<std::string, Value>& more) {
  for (const auto& [name, value] : more) add(value_of(name, sum), value);
}

}  // namespace

void count_one(const std::string& name, std::map<std::string, std::uint64_t>* counts) {
  ++value_of(name, *counts);
}

LinkStatistics sum(LinkStatistics before, const LinkStatistics& now) {
  add(before.request, now.request);
  add(before.message, now.message);
  add(before.status, now.status);
  add(before.odometry, now.odometry);
  add(before.messages_sent_to, now.messages_sent_to);
  add(before.rejected, now.rejected);
  add(before.refused, now.refused);
  add(before.dropped, now.dropped);
  before.inbox_dropped += now.inbox_dropped;
  before.dds_errors += now.dds_errors;
  if (!now.last_dds_error.empty()) before.last_dds_error = now.last_dds_error;
  before.wire_bytes_sent += now.wire_bytes_sent;
  before.wire_bytes_received += now.wire_bytes_received;
  for (const auto& [peer, clock] : now.clocks)
    if (before.clocks.size() < kMaxNames || before.clocks.count(peer) > 0)
      before.clocks[peer] = clock;
  add(before.restarts, now.restarts);
  before.process_cpu_ms += now.process_cpu_ms;
  before.process_peak_kib = std::max(before.process_peak_kib, now.process_peak_kib);
  return before;
}

}  // namespace covey
