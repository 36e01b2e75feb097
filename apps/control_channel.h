// SPDX-License-Identifier: Apache-2.0
//
// How a team and its agents' processes talk: lines of JSON over a socket that the agent inherits.
//
// An agent that can fly says `ready`; `meet` makes it wait for its peers. Then, in lockstep, in
// steps of about one image:
//   team  -> agent  receive   wait until that many requests and messages have arrived, take them
//   agent -> team   received
//   team  -> agent  advance   handle what was taken, then fly up to a moment of the recording
//   agent -> team   advanced  what was sent so far, to whom
// Everybody has taken what earlier steps sent before anybody sends more: which message meets which
// image depends on the recording alone, not on the machine. It ends with `finish`. Other paces need
// one `go`, and end by themselves. An agent that cannot start or go on says `failed` and ends; one
// whose team has gone (end of file) stops.
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "comms/link.h"
#include "estimator/measurements.h"

namespace covey {

struct MeetCommand {
  std::vector<std::string> peers;
  int patience_ms = 0;
};
struct ReceiveCommand {
  ArrivalCounts expected;  // since the start
  int patience_ms = 0;     // for them to arrive
};
struct AdvanceCommand {
  TimeNs until_ns = 0;  // included
};
struct GoCommand {
  double start_ms = 0;  // on the machine's monotonic clock, when the recording's `first_ns` is due
  TimeNs first_ns = 0;
};
struct FinishCommand {};
using Command = std::variant<MeetCommand, ReceiveCommand, AdvanceCommand, GoCommand, FinishCommand>;

struct ReadyReply {
  TimeNs first_ns = 0, last_ns = 0;  // first and last image
  double image_period_s = 0;         // mean
};
struct MetReply {
  bool all = false;
};
struct ReceivedReply {
  ArrivalCounts arrived;
};
// Unasked for in between, as a sign of progress, with `done` false.
struct AdvancedReply {
  bool done = false;
  TimeNs reached_ns = 0;
  std::uint64_t requests_sent = 0;
  std::map<std::string, std::uint64_t> messages_sent_to;
  double memory_mib = 0;  // own memory of the drone and its link's process; in signs of progress
};
struct FailedReply {
  std::string why;
};
using Reply = std::variant<ReadyReply, MetReply, ReceivedReply, AdvancedReply, FailedReply>;

[[nodiscard]] std::string encode(const Command& command);
[[nodiscard]] std::string encode(const Reply& reply);
// Throw std::runtime_error for anything that is not one.
[[nodiscard]] Command decode_command(const std::string& line);
[[nodiscard]] Reply decode_reply(const std::string& line);

// One end of the socket. Owns the descriptor.
class LineChannel {
 public:
  explicit LineChannel(int fd) : fd_(fd) {}
  ~LineChannel();
  LineChannel(LineChannel&& other) noexcept;
  LineChannel& operator=(LineChannel&&) = delete;
  LineChannel(const LineChannel&) = delete;
  LineChannel& operator=(const LineChannel&) = delete;

  // False when the other end has gone.
  bool send(const std::string& line);
  // A whole line if one has arrived; does not wait.
  [[nodiscard]] std::optional<std::string> take_line();
  // The other end has gone and no line is left. Does not wait.
  [[nodiscard]] bool closed();
  // For those who do not speak in lines.
  [[nodiscard]] int descriptor() const { return fd_; }

  // Waits until one of the channels has something, or the time is up, or a signal comes.
  static void wait(const std::vector<const LineChannel*>& channels,
                   std::chrono::milliseconds timeout);

 private:
  void read_available();

  int fd_ = -1;
  std::string buffer_;
  bool end_of_file_ = false;
};

}  // namespace covey
