// SPDX-License-Identifier: Apache-2.0
//
// A program started by this one, with a control channel between them.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <optional>
#include <string>
#include <vector>

#include "apps/control_channel.h"

namespace covey {

// Replaced in arguments by the number of the descriptor that the child inherits.
inline constexpr char kControlFdPlaceholder[] = "{control-fd}";

class ChildProcess {
 public:
  // Starts this very program again. Throws std::runtime_error if that is not possible.
  static ChildProcess start_self(std::vector<std::string> arguments);
  // The same, but it does not outlive the calling thread.
  static ChildProcess start_self_tied(std::vector<std::string> arguments);
  // Tied as well, which leaves no namespace behind, and inside a network namespace.
  static ChildProcess start_self_inside(int network_namespace, std::vector<std::string> arguments);

  ~ChildProcess();  // kills what still runs
  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&&) = delete;
  ChildProcess(const ChildProcess&) = delete;
  ChildProcess& operator=(const ChildProcess&) = delete;

  [[nodiscard]] LineChannel& channel() { return channel_; }
  [[nodiscard]] const LineChannel& channel() const { return channel_; }
  [[nodiscard]] pid_t pid() const { return pid_; }

  void terminate() const;  // SIGTERM
  void kill() const;       // SIGKILL

  // How it ended: empty for exit code 0, otherwise a few words. Nothing while it runs.
  [[nodiscard]] std::optional<std::string> ended(std::chrono::milliseconds patience);

 private:
  struct Bonds {
    int network_namespace = -1;  // a descriptor; -1: the caller's
    bool tied = false;           // to the calling thread's life
  };
  static ChildProcess start(std::vector<std::string> arguments, const Bonds& bonds);
  ChildProcess(pid_t pid, LineChannel channel) : pid_(pid), channel_(std::move(channel)) {}
  [[nodiscard]] bool reap();

  pid_t pid_ = -1;
  LineChannel channel_;
  std::optional<std::string> end_;
};

}  // namespace covey
