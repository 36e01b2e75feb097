// SPDX-License-Identifier: Apache-2.0
//
// One of Cyclone's programs, as docs/link.md (Another vendor's client) tells to start one, or
// another that says as they do what it hears.
#pragma once

#include <fcntl.h>
#include <poll.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "tests/comms/team_config.h"

namespace covey {

inline constexpr char kNoCyclone[] =
    "Cyclone DDS was not there when CMake ran: scripts/setup installs it, then configure again";

class CycloneClient {
 public:
  // Ready to listen once this returns.
  CycloneClient(const LinkConfig& team, const std::string& name)
      : CycloneClient({COVEY_CYCLONE_CLIENT, team.team, std::to_string(team.domain), name}) {}

  // `settings`: of Cyclone DDS, its own if empty.
  explicit CycloneClient(const std::vector<std::string>& command,
                         const std::string& settings = "file://" COVEY_CYCLONE_CONFIG) {
    int in[2], out[2];
    if (pipe2(in, O_CLOEXEC) != 0 || pipe2(out, O_CLOEXEC) != 0) std::perror("pipe2");
    std::vector<char*> argv;
    argv.reserve(command.size() + 1);
    for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
    argv.push_back(nullptr);
    std::string for_cyclone = "CYCLONEDDS_URI=" + settings;
    std::vector<char*> environment{for_cyclone.data()};  // the first of a name counts
    for (char** at = environ; *at != nullptr; ++at) environment.push_back(*at);
    environment.push_back(nullptr);
    pid_ = fork();  // all that allocates comes before: another thread may hold the allocator
    if (pid_ == 0) {
      dup2(in[0], STDIN_FILENO);
      dup2(out[1], STDOUT_FILENO);
      execve(argv.front(), argv.data(), environment.data());
      _exit(127);
    }
    close(in[0]);
    close(out[1]);
    input_ = in[1];
    output_ = out[0];
    (void)next(kPatience);
  }
  ~CycloneClient() {
    if (pid_ > 0) kill(pid_, SIGKILL);
    if (pid_ > 0) waitpid(pid_, nullptr, 0);
    if (input_ >= 0) close(input_);
    close(output_);
  }
  CycloneClient(const CycloneClient&) = delete;
  CycloneClient& operator=(const CycloneClient&) = delete;

  // The next sample that it tells of; nothing if none comes in time.
  std::optional<nlohmann::json> next(std::chrono::milliseconds patience) {
    const auto deadline = std::chrono::steady_clock::now() + patience;
    std::size_t end = 0;
    while ((end = text_.find('\n')) == std::string::npos) {
      const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
          deadline - std::chrono::steady_clock::now());
      if (left.count() <= 0 || !read_more(left)) return std::nullopt;
    }
    const std::string line = text_.substr(0, end);
    text_.erase(0, end + 1);
    return nlohmann::json::parse(line);
  }

  // Ends it in good order. The exit code, or -1.
  int finish() {
    close(std::exchange(input_, -1));
    while (read_more(kPatience)) text_.clear();
    int status = 0;
    waitpid(std::exchange(pid_, -1), &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  bool read_more(std::chrono::milliseconds patience) {
    pollfd output{output_, POLLIN, 0};
    if (poll(&output, 1, static_cast<int>(patience.count())) <= 0) return false;
    char buffer[4096];
    const ssize_t size = read(output_, buffer, sizeof(buffer));
    if (size > 0) text_.append(buffer, static_cast<std::size_t>(size));
    return size > 0;
  }

  pid_t pid_ = -1;
  int input_ = -1, output_ = -1;
  std::string text_;
};

}  // namespace covey
