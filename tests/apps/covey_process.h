// SPDX-License-Identifier: Apache-2.0
//
// The program itself, run as a person would run it.
#pragma once

#include <fcntl.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <string>
#include <vector>

namespace covey {

inline std::string file_content(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

class CoveyProcess {
 public:
  explicit CoveyProcess(const std::vector<std::string>& arguments) {
    int ends[2];
    if (pipe2(ends, O_CLOEXEC) != 0) std::perror("pipe2");
    std::vector<char*> argv{const_cast<char*>("covey")};
    for (const std::string& argument : arguments)
      argv.push_back(const_cast<char*>(argument.c_str()));
    argv.push_back(nullptr);
    pid_ = fork();  // all that allocates comes before: another thread may hold the allocator
    if (pid_ == 0) run(argv, ends[1]);
    close(ends[1]);
    output_ = fdopen(ends[0], "r");
  }
  ~CoveyProcess() {
    if (pid_ > 0) kill(pid_, SIGKILL);
    if (pid_ > 0) waitpid(pid_, nullptr, 0);
    std::fclose(output_);
  }
  CoveyProcess(const CoveyProcess&) = delete;
  CoveyProcess& operator=(const CoveyProcess&) = delete;

  // Reads on until a line holds the words; false at the end of the output.
  bool wait_for(const std::string& words) {
    while (read_line()) {
      if (line_.find(words) != std::string::npos) return true;
    }
    return false;
  }

  void send(int signal_number) const { kill(pid_, signal_number); }

  // Waits for the end. The exit code, or minus the signal.
  int finish() {
    while (read_line()) {
    }
    int status = 0;
    waitpid(pid_, &status, 0);
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -WTERMSIG(status);
  }

  // Both streams so far.
  [[nodiscard]] const std::string& output() const { return text_; }

 private:
  [[noreturn]] static void run(const std::vector<char*>& argv, int out) {
    dup2(out, STDOUT_FILENO);
    dup2(out, STDERR_FILENO);
    execv(COVEY_PROGRAM, argv.data());
    _exit(127);
  }

  bool read_line() {
    char* buffer = nullptr;
    std::size_t size = 0;
    const ssize_t length = getline(&buffer, &size, output_);
    if (length > 0) line_.assign(buffer, static_cast<std::size_t>(length));
    if (length > 0) text_ += line_;
    free(buffer);
    return length > 0;
  }

  pid_t pid_ = -1;
  FILE* output_ = nullptr;
  std::string line_, text_;
};

// The process whose command line holds the words, e.g. the path of an agent's configuration.
inline std::optional<pid_t> find_process(const std::string& words) {
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    if (file_content(entry.path() / "cmdline").find(words) != std::string::npos) {
      return static_cast<pid_t>(std::stol(name));
    }
  }
  return std::nullopt;
}

// Running, stopped or not yet waited for.
inline std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> children;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    const std::string status = file_content(entry.path() / "status");
    if (status.find("\nPPid:\t" + std::to_string(parent) + "\n") != std::string::npos)
      children.push_back(static_cast<pid_t>(std::stol(name)));
  }
  return children;
}

}  // namespace covey
