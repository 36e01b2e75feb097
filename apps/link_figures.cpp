// SPDX-License-Identifier: Apache-2.0
#include "apps/link_figures.h"

#include <spdlog/fmt/fmt.h>

#include <map>
#include <nlohmann/json.hpp>
#include <vector>

namespace covey {
namespace {

std::map<std::string, ClockSummary> clock_summaries(const LinkStatistics& statistics) {
  std::map<std::string, ClockSummary> clocks;
  for (const auto& [peer, clock] : statistics.clocks) {
    clocks[peer] = {1e-6 * static_cast<double>(clock.offset_ns),
                    1e-6 * static_cast<double>(clock.round_trip_ns)};
  }
  return clocks;
}

std::int64_t signed_count(std::uint64_t count) { return static_cast<std::int64_t>(count); }

// Those the link's checks refused and those that matched nothing here.
std::int64_t rejected_messages(const LinkStatistics& statistics, const PeerCounts& counts) {
  std::int64_t rejected = counts.rejected;
  for (const auto& [peer, reasons] : statistics.rejected) {
    for (const auto& [reason, count] : reasons) rejected += signed_count(count);
  }
  return rejected;
}

}  // namespace

LinkRecord link_record(TimeNs stamp_ns, const LinkStatistics& statistics,
                       const PeerCounts& counts) {
  LinkRecord record;
  record.stamp_ns = stamp_ns;
  record.requests_sent = signed_count(statistics.request.sent);
  record.requests_received = signed_count(statistics.request.received);
  record.messages_sent = signed_count(statistics.message.sent);
  record.messages_received = signed_count(statistics.message.received);
  record.fused = counts.fused;
  record.gated = counts.gated;
  record.rejected = rejected_messages(statistics, counts);
  record.payload_bytes_sent =
      signed_count(statistics.request.payload_bytes_sent + statistics.message.payload_bytes_sent);
  return record;
}

LinkSummary link_summary(const LinkStatistics& statistics, const PeerCounts& counts) {
  LinkSummary link;
  link.request.sent = signed_count(statistics.request.sent);
  link.request.received = signed_count(statistics.request.received);
  link.request.payload_bytes_sent = signed_count(statistics.request.payload_bytes_sent);
  link.message.sent = signed_count(statistics.message.sent);
  link.message.received = signed_count(statistics.message.received);
  link.message.payload_bytes_sent = signed_count(statistics.message.payload_bytes_sent);
  link.message.fused = counts.fused;
  link.message.gated = counts.gated;
  link.message.rejected = rejected_messages(statistics, counts);
  link.wire_bytes_sent = signed_count(statistics.wire_bytes_sent);
  link.wire_bytes_received = signed_count(statistics.wire_bytes_received);
  link.clocks = clock_summaries(statistics);
  link.restarts = {statistics.restarts.begin(), statistics.restarts.end()};
  return link;
}

nlohmann::json link_status_json(const std::set<std::string>& there,
                                const LinkStatistics& statistics, const PeerCounts& counts) {
  nlohmann::json status;
  status["peers"] = there;
  status["fused"] = counts.fused;
  status["rejected_by_link"] = statistics.rejected;
  status["dropped_by_load"] = statistics.dropped;
  status["clocks"] = to_json(clock_summaries(statistics));
  status["link_restarts"] = statistics.restarts;
  if (statistics.unseen_port != 0) status["link_unseen_port"] = statistics.unseen_port;
  if (!statistics.missing_network.empty())
    status["link_missing_network"] = statistics.missing_network;
  status["wire_bytes_sent"] = statistics.wire_bytes_sent;
  status["wire_bytes_received"] = statistics.wire_bytes_received;
  return status;
}

std::string words_on_peers(const std::set<std::string>& there, std::size_t expected,
                           const LinkStatistics& statistics) {
  std::vector<std::string> rejected;
  for (const auto& [peer, reasons] : statistics.rejected) {
    for (const auto& [reason, count] : reasons) {
      rejected.push_back(fmt::format("{} ({}, {} times)", peer, reason, count));
    }
  }
  return fmt::format("{} of {} peers found{}{}{}{}", there.size(), expected,
                     there.empty() ? "" : ": ", fmt::join(there, ", "),
                     rejected.empty() ? "" : "; rejected: ", fmt::join(rejected, ", "));
}

}  // namespace covey
