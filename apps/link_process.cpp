// SPDX-License-Identifier: Apache-2.0
#include "apps/link_process.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cctype>
#include <stdexcept>
#include <utility>

#include "apps/link_worker.h"
#include "apps/process_usage.h"
#include "comms/checks.h"
#include "comms/config_check.h"

namespace covey {
namespace {

using std::chrono::duration_cast;
using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kTick{50};  // between two looks at a silent process
// Eight reports. Shorter, and a busy machine counts as a hang; longer, and the link is not back
// within 2 s.
constexpr milliseconds kMaxSilence{800};
constexpr milliseconds kFirstStart{30'000};
constexpr milliseconds kLastWords{1000};  // and what the profile's farewell takes

// The link's process as the sender of what arrives; it refuses what comes from nobody.
constexpr PeerId kProcess = {1};

RecordKind record_of(Kind kind) {
  switch (kind) {
    case Kind::kRequest:
      return RecordKind::kRequest;
    case Kind::kMessage:
      return RecordKind::kMessage;
    case Kind::kFullMessage:
      return RecordKind::kFullMessage;
    case Kind::kStatus:
      return RecordKind::kStatus;
    case Kind::kOdometry:
      break;
  }
  return RecordKind::kOdometry;
}

// Its words go to a person's terminal.
std::string printable(std::string words) {
  for (char& c : words) c = std::isprint(static_cast<unsigned char>(c)) != 0 ? c : '?';
  return words;
}

LinkConfig checked(const LinkConfig& config) {
  check(config);
  return config;
}

ChildProcess start(const std::string& drone) {
  return ChildProcess::start_self_tied(
      {"covey", "link", "--drone", drone, "--fd", kControlFdPlaceholder});
}

}  // namespace

RestartPolicy::Duration RestartPolicy::pause_after(Duration life) {
  constexpr Duration kGoodLife{5000}, kFirst{100}, kLongest{1000};
  if (life >= kGoodLife)
    pause_ = Duration(0);
  else
    pause_ = std::clamp(2 * pause_, kFirst, kLongest);
  return pause_;
}

void RestartPolicy::started_in_time(bool in_time) {
  constexpr Duration kLongest{16'000};
  start_patience_ = in_time ? kFirstPatience : std::min(2 * start_patience_, kLongest);
}

// ------------------------------------------------------------------------------- the drone's side

LinkProcess::LinkProcess(const AgentConfig& config)
    : config_(checked(link_config(config))),
      settings_(to_bytes(print_config(config))),
      state_(config_.agent, config_.inbox_limit),
      supervisor_([this] { supervise(); }) {
  wait_until_on_the_air();
}

LinkProcess::~LinkProcess() { close(); }

void LinkProcess::wait_until_on_the_air() {
  std::string problem;
  {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, kFirstStart, [this] { return was_on_the_air_ || complaint_; });
    if (was_on_the_air_) return;
    problem = complaint_.value_or("the link has not started within 30 s: is the machine too busy?");
  }
  close();
  throw std::runtime_error(problem);
}

void LinkProcess::close() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
    if (channel_ != nullptr) channel_->wake();
  }
  changed_.notify_all();
  if (supervisor_.joinable()) supervisor_.join();
  state_.close();
}

bool LinkProcess::closing() const {
  const std::lock_guard lock(mutex_);
  return closing_;
}

bool LinkProcess::send(const PlaceAdvert& advert) { return offer(Kind::kRequest, advert); }

bool LinkProcess::send(const PeerKeyframe& keyframe) { return offer(Kind::kMessage, keyframe); }

bool LinkProcess::send(const FullPeerKeyframe& message) {
  return offer(Kind::kFullMessage, message);
}

bool LinkProcess::publish(const Odometry& odometry) {
  if (const Problem problem = problem_with(odometry)) {
    state_.count_refused(Kind::kOdometry, *problem);
    return false;
  }
  return offer(Kind::kOdometry, encode(OdometrySample{config_.agent, odometry}));
}

bool LinkProcess::publish(const AgentStatus& status) {
  if (const Problem problem = problem_with(status)) {
    state_.count_refused(Kind::kStatus, *problem);
    return false;
  }
  return offer(Kind::kStatus, encode(StatusSample{status, {}}));
}

template <typename Message>
bool LinkProcess::offer(Kind kind, const Message& message) {
  if (const Problem problem = problem_with(message)) {
    state_.count_refused(kind, *problem);
    return false;
  }
  return offer(kind, encode(message));
}

bool LinkProcess::offer(Kind kind, const Bytes& sample) {
  const std::lock_guard lock(mutex_);
  if (channel_ == nullptr) {
    state_.count_refused(kind, "the link is being started anew");
    return false;
  }
  if (channel_->offer(record_of(kind), sample)) return true;
  state_.count_refused(kind, "the link's process does not take it");
  return false;
}

std::set<std::string> LinkProcess::peers() const {
  const std::lock_guard lock(mutex_);
  return peers_;
}

template <typename Test>
bool LinkProcess::wait_until(const Test& enough, milliseconds timeout) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, timeout, [&] { return closing_ || enough(); });
  return enough();
}

bool LinkProcess::wait_for_peers(const std::set<std::string>& names, milliseconds timeout) {
  return wait_until(
      [&] { return std::includes(peers_.begin(), peers_.end(), names.begin(), names.end()); },
      timeout);
}

bool LinkProcess::wait_for_peers(std::size_t count, milliseconds timeout) {
  return wait_until([&] { return peers_.size() >= count; }, timeout);
}

bool LinkProcess::wait_for_inbox(const ArrivalCounts& at_least, milliseconds timeout) {
  return state_.wait_for_inbox(at_least, timeout);
}

LinkStatistics LinkProcess::statistics() const {
  LinkStatistics here = state_.statistics();
  // The process has counted them already.
  for (KindStatistics* kind : {&here.request, &here.message, &here.status})
    kind->received = kind->payload_bytes_received = 0;
  const std::lock_guard lock(mutex_);
  LinkStatistics all = sum(sum(before_, now_), here);
  all.process_own_kib = own_kib_;
  all.unseen_port = now_.unseen_port;
  all.missing_network = now_.missing_network;
  return all;
}

// --------------------------------------------------------------------------------- the supervisor

struct LinkProcess::Life {
  explicit Life(const std::string& drone) : process(start(drone)) {}

  ChildProcess process;
  RecordChannel channel{process.channel().descriptor()};
  milliseconds patience{0};  // for the next report
  milliseconds silence{0};   // since the last one, of the time in which this process itself ran
  bool on_the_air = false;
};

void LinkProcess::supervise() {
  state_.name_peer(kProcess, "link's process");
  RestartPolicy policy;
  while (!closing()) {
    const auto born = steady_clock::now();
    if (!bury(live(policy))) return;
    const auto pause = policy.pause_after(duration_cast<milliseconds>(steady_clock::now() - born));
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, pause, [this] { return closing_; });
  }
}

LinkProcess::End LinkProcess::live(RestartPolicy& policy) {
  try {
    Life life(config_.agent);
    life.patience = policy.start_patience();
    life.channel.offer(RecordKind::kSettings, settings_);
    End end = watch(life);
    policy.started_in_time(life.on_the_air);
    const std::lock_guard lock(mutex_);
    channel_ = nullptr;
    own_kib_ = 0;
    return end;
  } catch (const std::runtime_error& error) {
    return {"could not be started", error.what()};
  }
}

LinkProcess::End LinkProcess::watch(Life& life) {
  auto seen = steady_clock::now();
  while (true) {
    const bool open = life.channel.exchange(kTick);
    if (const auto end = take_records(life)) return *end;
    if (!open) {
      const std::string how = life.process.ended(kLastWords).value_or("closed its socket");
      return {how.empty() ? "ended by itself" : how, ""};
    }
    if (closing()) {
      end_in_good_order(life);
      return {};
    }
    // A drone that was paused as a whole does not blame its link for it.
    const auto now = steady_clock::now();
    life.silence +=
        std::min(duration_cast<milliseconds>(now - std::exchange(seen, now)), 2 * kTick);
    if (life.silence > life.patience) return {"did not report", ""};
    const double used_mib = memory_mib(std::to_string(life.process.pid()), "RssAnon").value_or(0);
    if (used_mib > config_.max_memory_mib) return {"used more than link.max_memory_mib", ""};
    const std::lock_guard lock(mutex_);
    own_kib_ = static_cast<std::uint64_t>(1024 * used_mib);
  }
}

// Nothing as long as it says what it can mean.
std::optional<LinkProcess::End> LinkProcess::take_records(Life& life) {
  while (const auto decoded = life.channel.next()) {
    const auto* record = std::get_if<Record>(&*decoded);
    if (record == nullptr) return End{"said no record", std::get<Rejected>(*decoded).reason};
    if (auto end = take(*record, life)) return end;
  }
  return std::nullopt;
}

std::optional<LinkProcess::End> LinkProcess::take(const Record& record, Life& life) {
  switch (record.kind) {
    case RecordKind::kReport:
      return take_report(record.content, life);
    case RecordKind::kComplaint:
      if (to_text(record.content) == kAddressesCame) return End{kAddressesCame, ""};
      return End{"gave up", printable(to_text(record.content))};
    case RecordKind::kRequest:
      state_.receive(Kind::kRequest, record.content, kProcess);
      return std::nullopt;
    case RecordKind::kMessage:
      state_.receive(Kind::kMessage, record.content, kProcess);
      return std::nullopt;
    case RecordKind::kFullMessage:
      state_.receive(Kind::kFullMessage, record.content, kProcess);
      return std::nullopt;
    case RecordKind::kStatus:
      state_.receive(Kind::kStatus, record.content, kProcess);
      return std::nullopt;
    case RecordKind::kSettings:
    case RecordKind::kOdometry:
      break;
  }
  return End{"said what only a drone says", ""};
}

std::optional<LinkProcess::End> LinkProcess::take_report(const Bytes& content, Life& life) {
  Decoded<LinkReport> decoded = decode_link_report(content);
  if (const auto* rejected = std::get_if<Rejected>(&decoded))
    return End{"reported nonsense", rejected->reason};
  auto& report = std::get<LinkReport>(decoded);
  report.statistics.missing_network = printable(report.statistics.missing_network);
  life.on_the_air = true;
  life.patience = kMaxSilence;
  life.silence = milliseconds(0);
  {
    const std::lock_guard lock(mutex_);
    now_ = std::move(report.statistics);
    peers_ = std::move(report.peers);
    channel_ = &life.channel;
    was_on_the_air_ = true;
  }
  changed_.notify_all();
  return std::nullopt;
}

void LinkProcess::end_in_good_order(Life& life) {
  const milliseconds patience = kLastWords + milliseconds(config_.profile.discovery.farewell_ms);
  const auto deadline = steady_clock::now() + patience;
  life.channel.finish(kLastWords);
  while (life.channel.exchange(kTick) && steady_clock::now() < deadline)
    if (take_records(life)) return;
  (void)take_records(life);
  (void)life.process.ended(kLastWords);
}

// False: there shall be no other life.
bool LinkProcess::bury(const End& end) {
  const std::string detail = end.words.empty() ? "" : ": " + end.words;
  {
    const std::lock_guard lock(mutex_);
    before_ = sum(std::move(before_), std::exchange(now_, {}));
    peers_.clear();
    if (end.reason.empty()) return false;
    ++before_.restarts[end.reason];
    if (!was_on_the_air_ && end.reason != "did not report")
      complaint_ =
          end.words.empty() ? "the link cannot be started: its process " + end.reason : end.words;
  }
  changed_.notify_all();
  if (complaint_) return false;
  spdlog::warn("the link is started anew: {}{}", end.reason, detail);
  return true;
}

}  // namespace covey
