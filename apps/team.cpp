// SPDX-License-Identifier: Apache-2.0
#include "apps/team.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "apps/agent.h"
#include "apps/child_process.h"
#include "apps/free_domain.h"
#include "apps/process_usage.h"
#include "apps/stop_signal.h"
#include "apps/whole_file.h"

namespace covey {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kMeetPatience{30'000};
constexpr milliseconds kMessagePatience{20'000};  // for what living drones sent
constexpr milliseconds kOrphanPatience{500};      // when one has died with messages on the way
constexpr milliseconds kFinishPatience{20'000};

// One drone as its team sees it.
struct Member {
  Member(std::string drone, ChildProcess started)
      : name(std::move(drone)), process(std::move(started)) {}

  std::string name;
  ChildProcess process;
  bool alive = true;
  bool replied = false;  // to what was asked last
  std::string failure;   // as it has told it itself
  ReadyReply ready;
  AdvancedReply sent;  // so far
  ArrivalCounts expected, arrived, written_off;
};

AgentConfig write_agent_config(const TeamOptions& options, const DroneFolder& drone, int domain) {
  AgentConfig config = agent_config(options, drone, domain);
  std::filesystem::create_directories(config.agent.out);
  write_whole_file(std::filesystem::path(config.agent.out) / kAgentConfigFile,
                   print_config(config));
  return config;
}

ChildProcess start_agent(const AgentConfig& config) {
  const auto file = std::filesystem::path(config.agent.out) / kAgentConfigFile;
  return ChildProcess::start_self(
      {"covey", "agent", "--config", file.string(), "--control-fd", kControlFdPlaceholder});
}

class TeamFlight {
 public:
  TeamFlight(const TeamOptions& options,
             const std::function<void(const FlightProgress&)>& on_progress)
      : options_(options), on_progress_(on_progress) {}

  FlightResult run() {
    start();
    if (!stop_requested()) meet();
    if (stop_requested()) {
      end_all();
      throw std::runtime_error("interrupted before the drones flew");
    }
    start_ms_ = steady_ms();
    if (options_.mode == FlightMode::kCollaborative && options_.pace == Pace::kLockstep) {
      fly_in_lockstep();
    } else {
      fly_freely();
    }
    result_.elapsed_s = (steady_ms() - start_ms_) * 1e-3;
    result_.recorded_s = seconds_between(first_ns_, reached_ns());
    end_all();
    return result_;
  }

 private:
  void start();
  void meet();
  void fly_in_lockstep();
  void fly_freely();
  [[nodiscard]] TimeNs whole_gap_ns(TimeNs now_ns, TimeNs step_ns) const;
  void receive();
  void advance(TimeNs until_ns);
  void end_all();

  [[nodiscard]] ArrivalCounts sent_to(const Member& receiver) const;
  void ask(Member& member, const Command& command);
  // Until all who were asked have replied, are dead, or a stop is wanted.
  void await_replies();
  void take_replies(Member& member);
  void accept(Member& member, const Reply& reply);
  void bury(Member& member);
  void show_progress();
  [[nodiscard]] TimeNs reached_ns() const;
  [[nodiscard]] bool any_alive() const;
  [[nodiscard]] bool waits_for_any() const;
  [[nodiscard]] std::vector<std::string> warnings_of_time() const;

  const TeamOptions& options_;
  const std::function<void(const FlightProgress&)>& on_progress_;
  std::optional<FreeDomain> domain_;  // unless each flies alone
  std::vector<Member> members_;
  TimeNs first_ns_ = 0, last_ns_ = 0;
  double start_ms_ = 0;
  bool starting_ = true;
  FlightResult result_;
};

void TeamFlight::start() {
  if (options_.mode == FlightMode::kCollaborative) domain_.emplace();
  for (const DroneFolder& drone : options_.drones) {
    const AgentConfig config = write_agent_config(options_, drone, domain_ ? domain_->id() : 0);
    members_.emplace_back(drone.name, start_agent(config));
  }
  await_replies();
  if (stop_requested()) return;
  first_ns_ = members_.front().ready.first_ns;
  for (const Member& member : members_) {
    first_ns_ = std::min(first_ns_, member.ready.first_ns);
    last_ns_ = std::max(last_ns_, member.ready.last_ns);
  }
  for (const std::string& warning : warnings_of_time()) spdlog::warn("{}", warning);
}

// Recordings that begin when all others are over are hardly of one clock.
std::vector<std::string> TeamFlight::warnings_of_time() const {
  std::vector<const Member*> by_begin;
  for (const Member& member : members_) by_begin.push_back(&member);
  std::sort(by_begin.begin(), by_begin.end(),
            [](const Member* a, const Member* b) { return a->ready.first_ns < b->ready.first_ns; });
  std::vector<std::string> warnings;
  TimeNs over_ns = by_begin.front()->ready.last_ns;
  for (const Member* member : by_begin) {
    const double wait_s = seconds_between(over_ns, member->ready.first_ns);
    if (wait_s > 0) {
      warnings.push_back(fmt::format(
          "{}: its recording begins {:.0f} s after those before it have ended: are they of one "
          "clock?",
          member->name, wait_s));
    }
    over_ns = std::max(over_ns, member->ready.last_ns);
  }
  return warnings;
}

void TeamFlight::meet() {
  if (options_.mode == FlightMode::kSolo) {
    starting_ = false;
    return;
  }
  for (Member& member : members_) {
    MeetCommand command;
    command.patience_ms = static_cast<int>(kMeetPatience.count());
    for (const Member& other : members_) {
      if (other.name != member.name) command.peers.push_back(other.name);
    }
    ask(member, command);
  }
  await_replies();
  starting_ = false;
}

void TeamFlight::fly_in_lockstep() {
  double step_s = members_.front().ready.image_period_s;
  for (const Member& member : members_) step_s = std::min(step_s, member.ready.image_period_s);
  show_progress();
  const TimeNs step_ns = std::max<TimeNs>(nanoseconds(step_s), 1'000'000);
  for (TimeNs now_ns = first_ns_; any_alive() && !stop_requested(); now_ns += step_ns) {
    receive();
    advance(now_ns);
    show_progress();
    if (now_ns >= last_ns_) break;
    now_ns += whole_gap_ns(now_ns, step_ns);
  }
  if (stop_requested()) return;
  for (Member& member : members_) {
    if (member.alive) member.process.channel().send(encode(FinishCommand{}));
  }
}

// Nobody flies for so long, in whole steps: recordings of several clocks may be years apart. What
// was on its way when the last image was flown has been answered by then.
TimeNs TeamFlight::whole_gap_ns(TimeNs now_ns, TimeNs step_ns) const {
  constexpr int kStepsOfAnswers = 20;
  TimeNs next_ns = last_ns_;
  for (const Member& member : members_) {
    const TimeNs begin_ns = member.ready.first_ns, end_ns = member.ready.last_ns;
    if (begin_ns <= now_ns && now_ns <= end_ns + kStepsOfAnswers * step_ns) return 0;
    if (begin_ns > now_ns) next_ns = std::min(next_ns, begin_ns);
  }
  // The loop's own step follows.
  return std::max<TimeNs>((next_ns - now_ns) / step_ns - 1, 0) * step_ns;
}

// What earlier steps sent arrives before anything new is sent.
void TeamFlight::receive() {
  for (Member& member : members_) {
    const ArrivalCounts expected = sent_to(member);
    const bool news = expected.requests > member.expected.requests ||
                      expected.messages > member.expected.messages;
    if (!member.alive || !news) continue;
    member.expected = expected;
    ReceiveCommand command;
    command.expected = expected;
    const auto patience = result_.ended_early.empty() ? kMessagePatience : kOrphanPatience;
    command.patience_ms = static_cast<int>(patience.count());
    ask(member, command);
  }
  await_replies();
  // What did not come will not come: its sender has died.
  for (Member& member : members_) {
    const auto missing = [](std::uint64_t& off, std::uint64_t& wanted, std::uint64_t got) {
      if (got >= wanted) return;
      off += wanted - got;
      wanted = got;
    };
    missing(member.written_off.requests, member.expected.requests, member.arrived.requests);
    missing(member.written_off.messages, member.expected.messages, member.arrived.messages);
  }
}

void TeamFlight::advance(TimeNs until_ns) {
  for (Member& member : members_) {
    if (member.alive) ask(member, AdvanceCommand{until_ns});
  }
  await_replies();
}

// At its own speed, or by the clock: the agents end by themselves.
void TeamFlight::fly_freely() {
  for (Member& member : members_) {
    if (member.alive) member.process.channel().send(encode(GoCommand{start_ms_, first_ns_}));
  }
  while (any_alive() && !stop_requested()) {
    std::vector<const LineChannel*> channels;
    for (Member& member : members_) {
      if (!member.alive) continue;
      take_replies(member);
      channels.push_back(&member.process.channel());
    }
    show_progress();
    if (any_alive()) LineChannel::wait(channels, milliseconds(200));
  }
}

void TeamFlight::end_all() {
  result_.interrupted = stop_requested();
  if (result_.interrupted) {
    for (Member& member : members_) member.process.terminate();
  }
  for (Member& member : members_) {
    if (!member.process.ended(kFinishPatience)) {
      member.process.kill();
      result_.ended_early.emplace(member.name, "did not end when asked to, and was killed");
    } else if (member.alive) {
      bury(member);
    }
  }
}

// By all the others, dead or alive, since the start.
ArrivalCounts TeamFlight::sent_to(const Member& receiver) const {
  ArrivalCounts sent;
  for (const Member& member : members_) {
    if (member.name == receiver.name) continue;
    sent.requests += member.sent.requests_sent;
    const auto messages = member.sent.messages_sent_to.find(receiver.name);
    if (messages != member.sent.messages_sent_to.end()) sent.messages += messages->second;
  }
  sent.requests -= std::min(sent.requests, receiver.written_off.requests);
  sent.messages -= std::min(sent.messages, receiver.written_off.messages);
  return sent;
}

void TeamFlight::ask(Member& member, const Command& command) {
  member.replied = false;
  member.process.channel().send(encode(command));  // a dead one is noticed when it does not reply
}

void TeamFlight::await_replies() {
  while (waits_for_any() && !stop_requested()) {
    std::vector<const LineChannel*> channels;
    for (Member& member : members_) {
      if (!member.alive || member.replied) continue;
      take_replies(member);
      if (member.alive && !member.replied) channels.push_back(&member.process.channel());
    }
    if (!channels.empty()) LineChannel::wait(channels, milliseconds(200));
  }
}

void TeamFlight::take_replies(Member& member) {
  while (const auto line = member.process.channel().take_line()) {
    accept(member, decode_reply(*line));
  }
  if (member.process.channel().closed()) bury(member);
}

void TeamFlight::accept(Member& member, const Reply& reply) {
  if (const auto* failed = std::get_if<FailedReply>(&reply)) {
    member.failure = failed->why;
    return;  // its end follows
  }
  member.replied = true;
  if (const auto* ready = std::get_if<ReadyReply>(&reply)) {
    member.ready = *ready;
    member.sent.reached_ns = ready->first_ns;
  } else if (const auto* received = std::get_if<ReceivedReply>(&reply)) {
    member.arrived = received->arrived;
  } else if (const auto* advanced = std::get_if<AdvancedReply>(&reply)) {
    member.sent = *advanced;
    member.replied = advanced->done;
  }
}

// Its process has ended or is about to.
void TeamFlight::bury(Member& member) {
  member.alive = false;
  const std::optional<std::string> end = member.process.ended(kFinishPatience);
  const std::string why = member.failure.empty() ? end.value_or("hangs") : member.failure;
  if (starting_ && !stop_requested()) {
    throw std::runtime_error(member.name +
                             " could not start: " + (why.empty() ? "its process ended" : why));
  }
  // After a stop all of them end early: that is no news.
  if (!why.empty() && !stop_requested()) result_.ended_early.emplace(member.name, why);
}

void TeamFlight::show_progress() {
  FlightProgress progress;
  progress.total_s = seconds_between(first_ns_, last_ns_);
  progress.flown_s = seconds_between(first_ns_, reached_ns());
  progress.elapsed_s = (steady_ms() - start_ms_) * 1e-3;
  on_progress_(progress);
}

// By the slowest of those that fly.
TimeNs TeamFlight::reached_ns() const {
  TimeNs slowest_ns = last_ns_;
  for (const Member& member : members_) {
    if (!member.alive) continue;
    const TimeNs reached_ns = std::max(first_ns_, member.sent.reached_ns);
    // One that has flown all it has does not hold up the others.
    if (reached_ns < member.ready.last_ns) slowest_ns = std::min(slowest_ns, reached_ns);
  }
  return slowest_ns;
}

bool TeamFlight::any_alive() const {
  return std::any_of(members_.begin(), members_.end(), [](const Member& m) { return m.alive; });
}

bool TeamFlight::waits_for_any() const {
  return std::any_of(members_.begin(), members_.end(),
                     [](const Member& m) { return m.alive && !m.replied; });
}

// A team that is to be secured stays so; its handshakes need the datagrams of profile `secure`.
ProfileChoice lockstep_profile(const LinkConfig& link) {
  ProfileChoice choice{"lockstep", "", {}};
  if (link.profile.security.required || !link.security.empty())
    choice.overrides = {{"security.required", "true"}, {"transport.datagram_bytes", "8000"}};
  return choice;
}

}  // namespace

AgentConfig agent_config(const TeamOptions& options, const DroneFolder& drone, int domain) {
  AgentConfig config;
  merge_config(options.config, options.config_name, config);
  config.agent.name = drone.name;
  config.agent.dataset = std::filesystem::absolute(drone.mav0).string();
  config.agent.out = (std::filesystem::absolute(options.out) / drone.name).string();
  config.agent.mode = options.mode;
  config.collaboration.exchange = options.exchange;
  config.agent.pace = options.pace;
  // Alone, nothing depends on how fast the others are.
  if (options.pace == Pace::kLockstep && options.mode == FlightMode::kSolo) {
    config.agent.pace = Pace::kMax;
  }
  config.agent.real_time_factor = options.real_time_factor;
  config.initialisation.method = options.init;
  if (options.unknown_start) {
    config.initialisation.own_world = true;
    config.fusion.drift.common_start = false;
  }
  // Keys belong to the team that the configuration names.
  if (config.link.security.empty()) config.link.team = "team" + std::to_string(getpid());
  config.link.domain = domain;
  config.link.loopback_only = true;
  const std::size_t drones = options.drones.size();
  if (options.mode == FlightMode::kCollaborative && drones > kMaxAgents) {
    throw std::runtime_error("a team has at most " + std::to_string(kMaxAgents) + " drones, not " +
                             std::to_string(drones));
  }
  const int linked_drones = std::min(static_cast<int>(drones), kMaxAgents);
  config.link.max_agents = std::max(config.link.max_agents, linked_drones);
  config.link.team_size = linked_drones;
  // Nothing of a radio: in lockstep nothing may be lost, however slow the machine.
  if (options.pace == Pace::kLockstep) config.link_profile = lockstep_profile(config.link);
  require_possible(config);
  return config;
}

FlightResult fly_team(const TeamOptions& options,
                      const std::function<void(const FlightProgress&)>& on_progress) {
  return TeamFlight(options, on_progress).run();
}

}  // namespace covey
