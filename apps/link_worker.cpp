// SPDX-License-Identifier: Apache-2.0
#include "apps/link_worker.h"

#include <sys/resource.h>
#include <sys/socket.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <csignal>
#include <exception>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>

#include "apps/config_file.h"
#include "apps/process_usage.h"
#include "apps/record_channel.h"
#include "comms/link_network.h"
#include "comms/peer_link.h"

namespace covey {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kReportInterval{100};
constexpr milliseconds kTakePoll{5};  // how late what has arrived is passed on at most
constexpr milliseconds kLastWords{1000};

// To what the process has claimed until now it may add so much. Beyond, DDS fails to allocate, and
// that ends it: between two looks of the drone it could otherwise claim all there is.
void limit_further_memory(int mib) {
  const double claimed_mib = memory_mib("self", "VmData").value_or(0);
  const auto bytes = static_cast<rlim_t>((claimed_mib + mib) * 1024 * 1024);
  rlimit limit{};
  getrlimit(RLIMIT_DATA, &limit);
  limit.rlim_cur = std::min(limit.rlim_max, bytes);
  setrlimit(RLIMIT_DATA, &limit);
}

class LinkWorker {
 public:
  LinkWorker(RecordChannel& channel, const LinkConfig& config)
      : channel_(channel), config_(config) {
    look_at_network();
  }

  // Until the drone has said its last. Everything on one thread: a report proves that it goes on.
  void serve() {
    while (channel_.exchange(kTakePoll)) {
      while (const auto record = channel_.next()) {
        send(*record);
        report_when_due();
      }
      pass_on_arrivals();
      look_at_network_when_due();
      report_when_due();
    }
    if (link_) link_->close();
    report();
    channel_.finish(kLastWords);
  }

 private:
  void send(const Decoded<Record>& decoded);
  template <typename Message>
  void send(KindStatistics& kind, const Decoded<Message>& message);
  void look_at_network_when_due();
  void look_at_network();
  void require_nothing_new() const;
  void pass_on_arrivals();
  void pass_on(RecordKind kind, const Bytes& sample);
  [[nodiscard]] LinkStatistics statistics() const;
  void report_when_due();
  void report();

  RecordChannel& channel_;
  const LinkConfig config_;
  LinkNetwork network_;
  std::optional<PeerLink> link_;  // once there is a network for it
  std::set<std::string> used_;    // own addresses that it was made on
  steady_clock::time_point made_;
  LinkStatistics before_;            // what was refused until then
  steady_clock::time_point looked_;  // at the network
  steady_clock::time_point reported_;
  std::uint64_t lost_ = 0;  // arrivals for which the drone had no room
};

void say(PeerLink& link, const PlaceAdvert& advert) { link.send(advert); }
void say(PeerLink& link, const PeerKeyframe& keyframe) { link.send(keyframe); }
void say(PeerLink& link, const FullPeerKeyframe& message) { link.send(message); }
void say(PeerLink& link, const StatusSample& sample) { link.publish(sample.status); }
void say(PeerLink& link, const OdometrySample& sample) { link.publish(sample.odometry); }

// Of what a drone cannot mean nothing is sent.
template <typename Message>
void LinkWorker::send(KindStatistics& kind, const Decoded<Message>& message) {
  const auto* valid = std::get_if<Message>(&message);
  if (valid == nullptr) return;
  if (link_) return say(*link_, *valid);
  ++kind.refused;
  ++before_.refused["the link waits for its network"];
}

void LinkWorker::send(const Decoded<Record>& decoded) {
  const auto* record = std::get_if<Record>(&decoded);
  if (record == nullptr) throw std::runtime_error(std::get<Rejected>(decoded).reason);
  switch (record->kind) {
    case RecordKind::kRequest:
      return send(before_.request, decode_place_advert(record->content));
    case RecordKind::kMessage:
      return send(before_.message, decode_peer_keyframe(record->content));
    case RecordKind::kFullMessage:
      return send(before_.message, decode_full_keyframe(record->content));
    case RecordKind::kStatus:
      return send(before_.status, decode_status(record->content));
    case RecordKind::kOdometry:
      return send(before_.odometry, decode_odometry(record->content));
    case RecordKind::kSettings:
    case RecordKind::kReport:
    case RecordKind::kComplaint:
      throw std::runtime_error("a drone says other records");
  }
}

void LinkWorker::look_at_network_when_due() {
  constexpr std::chrono::seconds kInterval{1};
  if (steady_clock::now() - looked_ >= kInterval) look_at_network();
}

// DDS has opened its sockets, and told the others where they are, once and for all. What comes and
// goes shall not keep a link from talking in between.
void LinkWorker::require_nothing_new() const {
  constexpr std::chrono::seconds kLeastLife{3};
  if (uses_too_little(used_, network_) && steady_clock::now() - made_ >= kLeastLife)
    throw std::runtime_error(kAddressesCame);
}

void LinkWorker::look_at_network() {
  looked_ = steady_clock::now();
  network_ = link_network(config_);
  if (link_) return require_nothing_new();
  const std::optional<LinkConfig> config = on_what_is_there(config_, network_);
  if (!config) return;
  link_.emplace(*config);
  used_ = network_.usable;
  made_ = steady_clock::now();
  limit_further_memory(config_.max_memory_mib);
}

void LinkWorker::pass_on(RecordKind kind, const Bytes& sample) {
  if (!channel_.offer(kind, sample)) ++lost_;
}

RecordKind kind_of(const PlaceAdvert& /*other*/) { return RecordKind::kRequest; }
RecordKind kind_of(const PeerKeyframe& /*other*/) { return RecordKind::kMessage; }
RecordKind kind_of(const FullPeerKeyframe& /*other*/) { return RecordKind::kFullMessage; }
RecordKind kind_of(const AgentStatus& /*other*/) { return RecordKind::kStatus; }

Bytes encode_again(const AgentStatus& status) { return encode(StatusSample{status, {}}); }
template <typename Message>
Bytes encode_again(const Message& message) {
  return encode(message);
}

void LinkWorker::pass_on_arrivals() {
  if (!link_) return;
  for (const Inbound& inbound : link_->take())
    std::visit([this](const auto& message) { pass_on(kind_of(message), encode_again(message)); },
               inbound);
}

void LinkWorker::report_when_due() {
  if (steady_clock::now() - reported_ >= kReportInterval) report();
}

LinkStatistics LinkWorker::statistics() const {
  const LinkStatistics now = link_ ? link_->statistics() : LinkStatistics();
  LinkStatistics all = sum(before_, now);
  all.unseen_port = now.unseen_port;
  all.missing_network = network_.missing;
  return all;
}

void LinkWorker::report() {
  LinkReport report{statistics(), link_ ? link_->peers() : std::set<std::string>()};
  report.statistics.inbox_dropped += lost_;
  report.statistics.process_cpu_ms = static_cast<std::uint64_t>(1e3 * process_cpu_s());
  report.statistics.process_peak_kib =
      static_cast<std::uint64_t>(1024 * peak_rss_mib().value_or(0));
  channel_.offer(RecordKind::kReport, encode(report));
  reported_ = steady_clock::now();
}

// The drone's first record.
LinkConfig receive_settings(RecordChannel& channel) {
  std::optional<Decoded<Record>> first;
  while (!(first = channel.next()))
    if (!channel.exchange(milliseconds(-1))) throw std::runtime_error("no settings came");
  const auto* record = std::get_if<Record>(&*first);
  if (record == nullptr || record->kind != RecordKind::kSettings)
    throw std::runtime_error("settings must come first");
  AgentConfig config;
  merge_config(nlohmann::json::parse(record->content), "the link's settings", config);
  return link_config(config);
}

// Its drone ends it, in good order: Ctrl-C reaches a whole group of processes.
void leave_signals_to_the_drone() {
  std::signal(SIGINT, SIG_IGN);
  std::signal(SIGTERM, SIG_IGN);
}

void require_socket(int fd) {
  int type = 0;
  socklen_t size = sizeof(type);
  if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) == 0) return;
  throw std::runtime_error("link: --fd " + std::to_string(fd) +
                           " is no socket: a drone starts its link, use covey agent");
}

}  // namespace

bool run_link(int socket) {
  RecordChannel channel(socket);
  try {
    LinkWorker(channel, receive_settings(channel)).serve();
    return true;
  } catch (const std::exception& error) {
    const std::string words = error.what();
    channel.offer(RecordKind::kComplaint,
                  to_bytes(words.substr(0, max_content(RecordKind::kComplaint))));
    channel.finish(kLastWords);
    return false;
  }
}

void add_link_command(CLI::App& covey) {
  struct Options {
    std::string drone;
    int fd = -1;
  };
  const auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand("link", "The process of one drone's link")->group("");
  command->add_option("--drone", options->drone, "For people who look at processes");
  command->add_option("--fd", options->fd, "Descriptor on which the drone speaks")->required();
  command->callback([options] {
    require_socket(options->fd);
    leave_signals_to_the_drone();
    if (!run_link(options->fd)) throw CLI::RuntimeError(1);
  });
}

}  // namespace covey
