// SPDX-License-Identifier: Apache-2.0
//
// The paces of a flight: as fast as possible, as a team says, or by the clock.
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <set>
#include <stdexcept>
#include <thread>
#include <utility>

#include "apps/agent.h"
#include "apps/bounded_queue.h"
#include "apps/image_reader.h"
#include "apps/live_flight.h"
#include "apps/stop_signal.h"

namespace covey {
namespace {

using std::chrono::milliseconds;

constexpr double kProgressInterval_ms = 250;
constexpr milliseconds kStopPoll{200};  // how soon a stop is seen while waiting

struct TimedImage {
  TimeNs stamp_ns = 0;
  cv::Mat pixels;
  double read_ms = 0;
};

std::optional<TimedImage> read_timed(ImageReader& reader, const ImageEntry& image) {
  const double start_ms = thread_cpu_ms();
  const std::optional<cv::Mat> pixels = reader.read(image);
  if (!pixels) return std::nullopt;
  return TimedImage{image.stamp_ns, *pixels, thread_cpu_ms() - start_ms};
}

// The team's end of the channel; absent when the drone flies by itself.
class Control {
 public:
  explicit Control(std::optional<int> fd) {
    if (fd) channel_.emplace(*fd);
  }

  [[nodiscard]] bool has_team() const { return channel_.has_value(); }

  // False: stopped, or the team has gone.
  [[nodiscard]] bool goes_on() { return !stop_requested() && !(channel_ && channel_->closed()); }

  void say(const Reply& reply) {
    if (channel_) channel_->send(encode(reply));
  }

  // Now and then, so that a person sees how far it is.
  void show_progress(const Agent& agent) {
    const double now_ms = steady_ms();
    if (now_ms - shown_ms_ < kProgressInterval_ms) return;
    shown_ms_ = now_ms;
    AdvancedReply sign = agent.progress();
    sign.memory_mib = agent.own_memory_mib();
    say(sign);
  }

  // Nothing when the flight is to end.
  std::optional<Command> next() {
    while (goes_on()) {
      if (const auto line = channel_->take_line()) return decode_command(*line);
      LineChannel::wait({&*channel_}, kStopPoll);
    }
    return std::nullopt;
  }

 private:
  std::optional<LineChannel> channel_;
  double shown_ms_ = 0;
};

ReadyReply ready_reply(const std::vector<ImageEntry>& images) {
  ReadyReply ready;
  ready.first_ns = images.front().stamp_ns;
  ready.last_ns = images.back().stamp_ns;
  if (images.size() > 1) {
    ready.image_period_s =
        seconds_between(ready.first_ns, ready.last_ns) / static_cast<double>(images.size() - 1);
  }
  return ready;
}

struct Flight {
  Agent& agent;
  ImageReader& reader;
  Control& control;
};

// Returns the index of the first image after `until_ns`, or earlier if stopped.
std::size_t fly_until(const Flight& flight, std::size_t next, TimeNs until_ns) {
  const std::vector<ImageEntry>& images = flight.agent.images();
  while (next < images.size() && images[next].stamp_ns <= until_ns && flight.control.goes_on()) {
    const std::optional<TimedImage> image = read_timed(flight.reader, images[next++]);
    flight.agent.set_dropped(flight.reader.left_out());
    if (image) flight.agent.fly(image->stamp_ns, image->pixels, image->read_ms);
    flight.control.show_progress(flight.agent);
  }
  return next;
}

bool fly_in_lockstep(const Flight& flight) {
  auto& [agent, reader, control] = flight;
  std::size_t next = 0;
  while (const auto command = control.next()) {
    if (std::holds_alternative<FinishCommand>(*command)) return true;
    if (const auto* receive = std::get_if<ReceiveCommand>(&*command)) {
      const ArrivalCounts arrived =
          agent.wait_for_arrivals(receive->expected, milliseconds(receive->patience_ms));
      agent.take_inbox();
      control.say(ReceivedReply{arrived});
    } else if (const auto* advance = std::get_if<AdvanceCommand>(&*command)) {
      agent.handle_messages();
      next = fly_until(flight, next, advance->until_ns);
      AdvancedReply reply = agent.progress();
      reply.done = true;
      control.say(reply);
    } else {
      throw std::runtime_error("the team speaks of another pace than 'lockstep'");
    }
  }
  return false;
}

// When the team starts its clock: the recording's first image is due now when there is no team.
// Nothing if there is to be no flight.
std::optional<GoCommand> wait_for_go(const Agent& agent, Control& control) {
  if (!control.has_team()) return GoCommand{steady_ms(), agent.images().front().stamp_ns};
  const std::optional<Command> command = control.next();
  if (!command) return std::nullopt;
  const auto* go = std::get_if<GoCommand>(&*command);
  if (go == nullptr) throw std::runtime_error("the team speaks of another pace");
  return *go;
}

bool fly_as_fast_as_possible(const Flight& flight) {
  auto& [agent, reader, control] = flight;
  if (!wait_for_go(agent, control)) return false;
  for (const ImageEntry& entry : agent.images()) {
    if (!control.goes_on()) return false;
    const std::optional<TimedImage> image = read_timed(reader, entry);
    agent.set_dropped(reader.left_out());
    agent.take_inbox();
    agent.handle_messages();
    if (image) agent.fly(image->stamp_ns, image->pixels, image->read_ms);
    control.show_progress(agent);
  }
  return true;
}

// Reads each image when it is due, as a camera would deliver it, whether or not the drone is ready.
class ClockReader {
 public:
  ClockReader(const Agent& agent, ImageReader& reader, const GoCommand& go)
      : agent_(agent),
        reader_(reader),
        go_(go),
        queue_(static_cast<std::size_t>(agent.config().agent.image_queue)),
        thread_([this] { read_all(); }) {}
  ~ClockReader() {
    queue_.close();
    thread_.join();
  }
  ClockReader(const ClockReader&) = delete;
  ClockReader& operator=(const ClockReader&) = delete;

  [[nodiscard]] std::optional<TimedImage> next(milliseconds patience) {
    return queue_.pop_for(patience);
  }
  [[nodiscard]] bool finished() const { return queue_.finished(); }
  // Those that cannot be read among them.
  [[nodiscard]] std::uint64_t dropped() const { return queue_.dropped() + reader_.left_out(); }
  // What stopped the reading, once finished.
  void rethrow_failure() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  void read_all() {
    try {
      for (const ImageEntry& entry : agent_.images()) {
        if (born_ms_ - due_ms(entry.stamp_ns) > kTooLate_ms) continue;
        if (!wait_until_due(entry.stamp_ns)) break;
        std::optional<TimedImage> image = read_timed(reader_, entry);
        if (image && !queue_.push_drop_oldest(std::move(*image))) break;
      }
    } catch (...) {
      failure_ = std::current_exception();
    }
    queue_.close();
  }

  // False when nobody wants more images.
  [[nodiscard]] bool wait_until_due(TimeNs stamp_ns) const {
    while (!queue_.closed() && !stop_requested()) {
      const double left_ms = due_ms(stamp_ns) - steady_ms();
      if (left_ms <= 0) return true;
      const double nap_ms = std::min(left_ms, static_cast<double>(kStopPoll.count()));
      std::this_thread::sleep_for(std::chrono::duration<double, std::milli>(nap_ms));
    }
    return false;
  }

  [[nodiscard]] double due_ms(TimeNs stamp_ns) const {
    const double rate = agent_.config().agent.real_time_factor;
    return go_.start_ms + 1e3 * seconds_between(go_.first_ns, stamp_ns) / rate;
  }

  // A drone that is started again in flight sees what comes from then on, not what it has missed.
  static constexpr double kTooLate_ms = 500;

  const Agent& agent_;
  ImageReader& reader_;
  const GoCommand go_;
  const double born_ms_ = steady_ms();
  BoundedQueue<TimedImage>
      queue_;                   // full: the oldest image is dropped, as a late camera's would be
  std::exception_ptr failure_;  // written before the queue is closed, read after
  std::thread thread_;
};

bool fly_by_clock(const Flight& flight) {
  auto& [agent, images, control] = flight;
  constexpr milliseconds kInboxPoll{5};  // messages are handled between images as well
  const std::optional<GoCommand> go = wait_for_go(agent, control);
  if (!go) return false;
  ClockReader reader(agent, images, *go);
  while (!reader.finished() && control.goes_on()) {
    const std::optional<TimedImage> image = reader.next(kInboxPoll);
    agent.take_inbox();
    agent.handle_messages();
    agent.set_dropped(reader.dropped());
    if (image) agent.fly(image->stamp_ns, image->pixels, image->read_ms);
    agent.show_status();
    control.show_progress(agent);
  }
  agent.set_dropped(reader.dropped());
  if (reader.finished()) reader.rethrow_failure();
  return control.goes_on();
}

bool fly(const Flight& flight) {
  switch (flight.agent.config().agent.pace) {
    case Pace::kMax:
      return fly_as_fast_as_possible(flight);
    case Pace::kLockstep:
      return fly_in_lockstep(flight);
    case Pace::kRate:
      return fly_by_clock(flight);
    case Pace::kLive:
      break;  // flies no recording
  }
  throw std::logic_error("unknown pace");
}

// False: stopped meanwhile. Flies without those that do not come.
bool meet_peers(Agent& agent, Control& control) {
  const AgentSettings& settings = agent.config().agent;
  if (settings.mode == FlightMode::kSolo) return true;
  bool all = true;
  auto expected = static_cast<std::size_t>(settings.wait_for_peers);
  if (!control.has_team()) {
    const auto patience = static_cast<std::int64_t>(1e3 * settings.peer_timeout_s);
    all = agent.meet(expected, milliseconds(patience));
  } else {
    const std::optional<Command> command = control.next();
    if (!command) return false;
    const auto* meet = std::get_if<MeetCommand>(&*command);
    if (meet == nullptr) throw std::runtime_error("the team does not say whom to meet");
    expected = meet->peers.size();
    all = agent.meet(std::set<std::string>(meet->peers.begin(), meet->peers.end()),
                     milliseconds(meet->patience_ms));
    control.say(MetReply{all});
  }
  if (!all && control.goes_on()) {
    spdlog::warn("{}; flying with those that are there", agent.words_on_peers(expected));
  }
  return control.goes_on();
}

// Who names addresses means to be heard there.
void warn_of_loopback(const AgentConfig& config) {
  const LinkConfig& link = config.link;
  const bool names_addresses = !link.interfaces.empty() || !link.initial_peers.empty();
  if (config.agent.mode == FlightMode::kSolo || !link.loopback_only || !names_addresses) return;
  spdlog::warn(
      "link.interfaces and link.initial_peers are of no use while link.loopback_only is true: "
      "nothing leaves this computer");
}

// Nobody else does.
void tell_result(const AgentConfig& config, const AgentSummary& summary) {
  if (summary.not_started) throw std::runtime_error("did not start: " + *summary.not_started);
  std::printf("%s: %lld images, started after %.1f s; results in %s\n", config.agent.name.c_str(),
              static_cast<long long>(summary.frames), summary.initialised_after_s.value_or(0),
              config.agent.out.c_str());
}

bool fly_recording(const AgentConfig& config, Control& control) {
  Agent agent(config);
  for (const std::string& warning : agent.warnings()) spdlog::warn("{}", warning);
  control.say(ready_reply(agent.images()));
  ImageReader reader(agent.camera());
  const bool complete = meet_peers(agent, control) && fly({agent, reader, control});
  const AgentSummary summary =
      agent.finish(complete ? std::nullopt : std::optional<std::string>("was stopped"));
  if (complete && !control.has_team()) tell_result(config, summary);
  return complete;
}

}  // namespace

bool run_agent(const AgentConfig& config, std::optional<int> control_fd) {
  if (!control_fd) warn_of_loopback(config);
  if (config.agent.pace == Pace::kLive) {
    if (control_fd) throw std::runtime_error("pace 'live' flies no recording, as teams do");
    return run_live_agent(config);
  }
  if (config.agent.pace == Pace::kLockstep && !control_fd)
    throw std::runtime_error("pace 'lockstep' needs a team; use 'max' or 'rate' alone");
  Control control(control_fd);
  try {
    return fly_recording(config, control);
  } catch (const std::exception& error) {
    if (!control.has_team()) throw;
    control.say(FailedReply{error.what()});
    return false;
  }
}

}  // namespace covey
