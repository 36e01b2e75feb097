// SPDX-License-Identifier: Apache-2.0
#include "apps/child_process.h"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <thread>
#include <utility>

#include "apps/stop_signal.h"

namespace covey {
namespace {

[[noreturn]] void fail(const std::string& what) {
  throw std::runtime_error("a process cannot be started: " + what + ": " + std::strerror(errno));
}

// Between fork and exec: system calls only.
bool tie_to(pid_t parent) {
  return prctl(PR_SET_PDEATHSIG, SIGKILL) == 0 && getppid() == parent;  // it may just have died
}

// All but the standard streams and `fd` end at exec, whoever opened them.
void keep_only(int fd) {
  close_range(STDERR_FILENO + 1, ~0U, CLOSE_RANGE_CLOEXEC);
  fcntl(fd, F_SETFD, 0);
}

// While it lives no signal comes: one that is sent to a child between fork and exec waits until the
// child is no longer its parent's copy, which would note it and forget.
class BlockedSignals {
 public:
  BlockedSignals() {
    sigset_t all;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before_);
  }
  ~BlockedSignals() { restore(); }
  BlockedSignals(const BlockedSignals&) = delete;
  BlockedSignals& operator=(const BlockedSignals&) = delete;

  void restore() const { pthread_sigmask(SIG_SETMASK, &before_, nullptr); }

 private:
  sigset_t before_{};
};

std::string describe_end(int status) {
  if (WIFSIGNALED(status)) {
    const int number = WTERMSIG(status);
    const char* name = sigabbrev_np(number);
    return "killed by signal " + std::to_string(number) +
           (name == nullptr ? "" : std::string(" (SIG") + name + ")");
  }
  const int code = WEXITSTATUS(status);
  return code == 0 ? "" : "ended with exit code " + std::to_string(code);
}

}  // namespace

ChildProcess ChildProcess::start_self(std::vector<std::string> arguments) {
  return start(std::move(arguments), {});
}

ChildProcess ChildProcess::start_self_tied(std::vector<std::string> arguments) {
  return start(std::move(arguments), {-1, true});
}

ChildProcess ChildProcess::start_self_inside(int network_namespace,
                                             std::vector<std::string> arguments) {
  return start(std::move(arguments), {network_namespace, true});
}

ChildProcess ChildProcess::start(std::vector<std::string> arguments, const Bonds& bonds) {
  int ends[2];
  if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) fail("socketpair");
  LineChannel own(ends[0]);
  LineChannel childs(ends[1]);

  // All that allocates comes before the fork.
  for (std::string& argument : arguments) {
    if (argument == kControlFdPlaceholder) argument = std::to_string(ends[1]);
  }
  std::vector<char*> argv;
  argv.reserve(arguments.size() + 1);
  for (std::string& argument : arguments) argv.push_back(argument.data());
  argv.push_back(nullptr);

  const pid_t parent = getpid();
  const BlockedSignals blocked;
  const pid_t pid = fork();
  if (pid < 0) fail("fork");
  if (pid == 0) {
    release_stop_signals();
    blocked.restore();
    const bool inside =
        bonds.network_namespace < 0 || setns(bonds.network_namespace, CLONE_NEWNET) == 0;
    if (!inside || (bonds.tied && !tie_to(parent))) _exit(127);
    keep_only(ends[1]);
    execv("/proc/self/exe", argv.data());
    _exit(127);
  }
  return {pid, std::move(own)};
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)),
      channel_(std::move(other.channel_)),
      end_(std::move(other.end_)) {}

ChildProcess::~ChildProcess() {
  if (pid_ < 0 || end_) return;
  kill();
  int status = 0;
  while (waitpid(pid_, &status, 0) < 0 && errno == EINTR) {
  }
}

void ChildProcess::terminate() const {
  if (!end_) ::kill(pid_, SIGTERM);
}

void ChildProcess::kill() const {
  if (!end_) ::kill(pid_, SIGKILL);
}

bool ChildProcess::reap() {
  int status = 0;
  if (!end_ && waitpid(pid_, &status, WNOHANG) == pid_) end_ = describe_end(status);
  return end_.has_value();
}

std::optional<std::string> ChildProcess::ended(std::chrono::milliseconds patience) {
  const auto deadline = std::chrono::steady_clock::now() + patience;
  while (!reap() && std::chrono::steady_clock::now() < deadline) {
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return end_;
}

}  // namespace covey
