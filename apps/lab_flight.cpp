// SPDX-License-Identifier: Apache-2.0
#include "apps/lab_flight.h"

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <utility>

#include "apps/agent.h"
#include "apps/child_process.h"
#include "apps/process_usage.h"
#include "apps/stop_signal.h"
#include "apps/whole_file.h"
#include "sim/random.h"

namespace covey {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kPoll{50};
constexpr int kMeetPatience_ms = 60'000;
constexpr int kMeetAgainPatience_ms = 10'000;  // after a kill; then it flies without
constexpr milliseconds kFinishPatience{20'000};
constexpr double kOvertime_s = 60;  // after the last image is due; then an agent hangs
// Nobody is killed so close to the start of a flight, or started again so close to its end: there
// is nobody to meet afterwards.
constexpr double kFirstKill_s = 1, kLastReturn_s = 5;

enum class Phase { kStarting, kMeeting, kFlying, kEnded };

struct Member {
  AgentConfig config;
  std::unique_ptr<ChildProcess> process;
  Phase phase = Phase::kStarting;
  bool met = false;
  std::string failure;  // as it has told it itself
  ReadyReply ready;
  double ready_ms = 0, met_ms = 0, last_sign_ms = 0;
  TimeNs reached_ns = 0;
  // Of the life after a kill.
  std::size_t kill = 0;  // index among them
  int lives = 1;
  std::optional<double> again_at_ms, started_again_ms;
};

class LabFlight {
 public:
  LabFlight(const LabFlightPlan& plan, DroneNetwork& network,
            const std::function<void(const FlightProgress&)>& on_progress)
      : plan_(plan), network_(network), on_progress_(on_progress), random_(plan.seed, 0xdead) {}

  LabFlightResult run() {
    for (std::size_t i = 0; i < plan_.agents.size(); ++i) {
      members_.emplace_back();
      members_[i].config = plan_.agents[i];
      start(i);
    }
    meet();
    result_.meeting = network_.frames().counts();
    if (!plan_.fly) wait(plan_.settle_s);
    const std::vector<PortCounts> before = network_.frames().counts();
    const double start_ms = steady_ms();
    if (plan_.fly) {
      fly();
    } else {
      wait(plan_.hold_s);
    }
    result_.together_s = (steady_ms() - start_ms) * 1e-3;
    count_frames_since(before);
    end_all();
    return result_;
  }

 private:
  void start(std::size_t drone);
  void start_again(std::size_t drone);
  void meet();
  void wait(double seconds);
  void fly();
  void kill_one();
  void poll();
  void take_replies(std::size_t drone);
  void accept(std::size_t drone, const Reply& reply);
  void ask_to_meet(std::size_t drone);
  void bury(std::size_t drone);
  void count_frames_since(const std::vector<PortCounts>& before);
  void end_all();
  void show_progress();

  [[nodiscard]] bool all(Phase phase) const {
    return std::all_of(members_.begin(), members_.end(),
                       [phase](const Member& m) { return m.phase == phase; });
  }
  [[nodiscard]] bool all_have_met() const {
    return std::all_of(members_.begin(), members_.end(), [](const Member& m) { return m.met; });
  }
  [[nodiscard]] bool over() const {
    return std::all_of(members_.begin(), members_.end(),
                       [](const Member& m) { return m.phase == Phase::kEnded && !m.again_at_ms; });
  }

  const LabFlightPlan& plan_;
  DroneNetwork& network_;
  const std::function<void(const FlightProgress&)>& on_progress_;
  Random random_;
  std::vector<Member> members_;
  bool flying_ = false;
  TimeNs last_ns_ = 0;
  std::vector<double> kills_s_;  // still to come, the next one last
  LabFlightResult result_;
};

void LabFlight::start(std::size_t drone) {
  Member& member = members_[drone];
  const std::filesystem::path out = member.config.agent.out;
  std::filesystem::create_directories(out);
  write_whole_file(out / kAgentConfigFile, print_config(member.config));
  member.process = std::make_unique<ChildProcess>(ChildProcess::start_self_inside(
      network_.namespace_of(drone),
      {"covey", "agent", "--config", (out / kAgentConfigFile).string(), "--control-fd",
       kControlFdPlaceholder}));
  member.phase = Phase::kStarting;
}

// In a folder of its own: what the one that was killed has left stays.
void LabFlight::start_again(std::size_t drone) {
  Member& member = members_[drone];
  member.again_at_ms.reset();
  member.met = false;
  member.config.agent.out =
      plan_.agents[drone].agent.out + "/again" + std::to_string(member.lives++);
  member.started_again_ms = steady_ms();
  start(drone);
}

void LabFlight::meet() {
  while (!all(Phase::kMeeting) && !stop_requested()) poll();
  if (stop_requested()) return;
  double open_ms = 0;
  result_.first_ns = members_.front().ready.first_ns;
  for (const Member& member : members_) {
    open_ms = std::max(open_ms, member.ready_ms);
    result_.first_ns = std::min(result_.first_ns, member.ready.first_ns);
    last_ns_ = std::max(last_ns_, member.ready.last_ns);
  }
  while (!all_have_met() && !stop_requested() && steady_ms() - open_ms < kMeetPatience_ms) poll();
  if (all_have_met()) {
    double met_ms = open_ms;
    for (const Member& member : members_) met_ms = std::max(met_ms, member.met_ms);
    result_.met_after_s = (met_ms - open_ms) * 1e-3;
  }
}

void LabFlight::wait(double seconds) {
  const double until_ms = steady_ms() + 1e3 * seconds;
  while (steady_ms() < until_ms && !stop_requested()) poll();
}

void LabFlight::fly() {
  result_.start_ms = steady_ms();
  network_.frames().begin_flight(result_.start_ms, plan_.pace);
  const double flight_s = seconds_between(result_.first_ns, last_ns_) / plan_.pace;
  kills_s_ = kill_moments(plan_.kills, flight_s, plan_.seed);
  std::reverse(kills_s_.begin(), kills_s_.end());
  flying_ = true;
  for (Member& member : members_) {
    member.process->channel().send(encode(GoCommand{result_.start_ms, result_.first_ns}));
    member.phase = Phase::kFlying;
    member.last_sign_ms = result_.start_ms;
  }
  while (!over() && !stop_requested()) {
    poll();
    const double flown_s = (steady_ms() - result_.start_ms) * 1e-3;
    if (flown_s > flight_s + kOvertime_s) break;  // end_all names who hangs
    if (!kills_s_.empty() && flown_s >= kills_s_.back()) kill_one();
    for (std::size_t i = 0; i < members_.size(); ++i) {
      if (members_[i].again_at_ms && steady_ms() >= *members_[i].again_at_ms) start_again(i);
    }
    show_progress();
  }
  result_.flight.elapsed_s = (steady_ms() - result_.start_ms) * 1e-3;
  result_.flight.recorded_s = seconds_between(result_.first_ns, last_ns_);
}

// Any one that flies.
void LabFlight::kill_one() {
  std::vector<std::size_t> flying;
  for (std::size_t i = 0; i < members_.size(); ++i) {
    if (members_[i].phase == Phase::kFlying) flying.push_back(i);
  }
  kills_s_.pop_back();
  if (flying.empty()) return;
  Member& member = members_[flying[random_.index(flying.size())]];
  member.process->kill();
  (void)member.process->ended(kFinishPatience);
  member.phase = Phase::kEnded;
  member.kill = result_.kills.size();
  member.again_at_ms = steady_ms() + 1e3 * plan_.kills.again_after_s;
  result_.kills.push_back(
      {member.config.agent.name, (steady_ms() - result_.start_ms) * 1e-3, std::nullopt});
}

void LabFlight::poll() {
  std::vector<const LineChannel*> channels;
  for (std::size_t i = 0; i < members_.size(); ++i) {
    if (members_[i].phase == Phase::kEnded) continue;
    take_replies(i);
    if (members_[i].phase != Phase::kEnded) channels.push_back(&members_[i].process->channel());
  }
  LineChannel::wait(channels, kPoll);
}

void LabFlight::take_replies(std::size_t drone) {
  LineChannel& channel = members_[drone].process->channel();
  while (const auto line = channel.take_line()) accept(drone, decode_reply(*line));
  if (channel.closed()) bury(drone);
}

void LabFlight::accept(std::size_t drone, const Reply& reply) {
  Member& member = members_[drone];
  const double now_ms = steady_ms();
  if (const auto* ready = std::get_if<ReadyReply>(&reply)) {
    member.ready = *ready;
    member.ready_ms = now_ms;
    member.phase = Phase::kMeeting;
    ask_to_meet(drone);
  } else if (const auto* met = std::get_if<MetReply>(&reply)) {
    member.met = met->all;
    member.met_ms = now_ms;
    if (!member.started_again_ms) return;
    if (met->all) {
      result_.kills[member.kill].met_again_s = (now_ms - *member.started_again_ms) * 1e-3;
    }
    member.process->channel().send(encode(GoCommand{result_.start_ms, result_.first_ns}));
    member.phase = Phase::kFlying;
    member.last_sign_ms = now_ms;
  } else if (const auto* advanced = std::get_if<AdvancedReply>(&reply)) {
    member.reached_ns = advanced->reached_ns;
    result_.longest_silence_s =
        std::max(result_.longest_silence_s, (now_ms - member.last_sign_ms) * 1e-3);
    member.last_sign_ms = now_ms;
    result_.memory.push_back(
        {member.config.agent.name, (now_ms - result_.start_ms) * 1e-3, advanced->memory_mib});
  } else if (const auto* failed = std::get_if<FailedReply>(&reply)) {
    member.failure = failed->why;
  }
}

void LabFlight::ask_to_meet(std::size_t drone) {
  MeetCommand command;
  command.patience_ms = flying_ ? kMeetAgainPatience_ms : kMeetPatience_ms;
  for (const Member& other : members_) {
    if (&other != &members_[drone]) command.peers.push_back(other.config.agent.name);
  }
  members_[drone].process->channel().send(encode(command));
}

// Its process has ended or is about to, and nobody has killed it.
void LabFlight::bury(std::size_t drone) {
  Member& member = members_[drone];
  member.phase = Phase::kEnded;
  const std::optional<std::string> end = member.process->ended(kFinishPatience);
  const std::string why = member.failure.empty() ? end.value_or("hangs") : member.failure;
  if (stop_requested()) return;
  if (!flying_) {
    throw std::runtime_error(member.config.agent.name +
                             " could not start: " + (why.empty() ? "its process ended" : why));
  }
  if (!why.empty()) result_.flight.ended_early.emplace(member.config.agent.name, why);
}

void LabFlight::count_frames_since(const std::vector<PortCounts>& before) {
  const std::vector<PortCounts> counts = network_.frames().counts();
  for (std::size_t i = 0; i < counts.size(); ++i) {
    result_.together.push_back(difference(counts[i], before[i]));
  }
}

void LabFlight::end_all() {
  result_.flight.interrupted = stop_requested();
  for (Member& member : members_) {
    if (member.phase != Phase::kEnded) member.process->terminate();
  }
  for (Member& member : members_) {
    if (member.phase == Phase::kEnded) continue;
    const bool was_to_end = !plan_.fly || stop_requested();
    const auto end = member.process->ended(kFinishPatience);
    if (!end) member.process->kill();
    if (!was_to_end || !end) {
      result_.flight.ended_early.emplace(member.config.agent.name, "did not end, and was stopped");
    }
  }
}

void LabFlight::show_progress() {
  FlightProgress progress;
  progress.total_s = seconds_between(result_.first_ns, last_ns_);
  progress.elapsed_s = (steady_ms() - result_.start_ms) * 1e-3;
  progress.flown_s = std::min(progress.total_s, progress.elapsed_s * plan_.pace);
  on_progress_(progress);
}

}  // namespace

LabFlightResult fly_in_lab(const LabFlightPlan& plan, DroneNetwork& network,
                           const std::function<void(const FlightProgress&)>& on_progress) {
  return LabFlight(plan, network, on_progress).run();
}

std::vector<double> kill_moments(const LabKills& kills, double flight_s, std::uint64_t seed) {
  std::vector<double> moments;
  const double last_s = flight_s - kLastReturn_s - kills.again_after_s;
  if (last_s <= kFirstKill_s) return moments;
  Random random(seed, 0x5161);
  for (int i = 0; i < kills.count; ++i) {
    moments.push_back(random.uniform(kFirstKill_s, last_s));
  }
  std::sort(moments.begin(), moments.end());
  return moments;
}

PortCounts difference(const PortCounts& later, const PortCounts& earlier) {
  PortCounts counts;
  for (std::uint64_t PortCounts::*field :
       {&PortCounts::frames_sent, &PortCounts::bytes_sent, &PortCounts::delivered,
        &PortCounts::lost, &PortCounts::queue_full, &PortCounts::cut}) {
    counts.*field = later.*field - earlier.*field;
  }
  return counts;
}

}  // namespace covey
