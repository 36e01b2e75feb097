// SPDX-License-Identifier: Apache-2.0
//
// What a process costs, this one above all: CPU time of all its threads and memory.
#pragma once

#include <optional>
#include <string>

namespace covey {

[[nodiscard]] double steady_ms();  // ms, monotonic, from an arbitrary start

// ms of CPU time that the calling thread has used: what a stage costs, whoever else is running.
[[nodiscard]] double thread_cpu_ms();

[[nodiscard]] double process_cpu_s();  // s, user and system, all threads

// One of the Vm... and Rss... lines of /proc/PROCESS/status, MiB. Nothing where that is not there.
[[nodiscard]] std::optional<double> memory_mib(const std::string& process,
                                               const std::string& field);

// Peak of the resident memory, MiB. What getrusage reports would include the program that started
// this one.
[[nodiscard]] std::optional<double> peak_rss_mib();

// Highest share of one core over windows of at least a second of wall time.
class CpuLoadMonitor {
 public:
  // Whether a sample is of use now; it is ignored otherwise.
  [[nodiscard]] bool due(double now_ms) const;
  void sample(double now_ms, double cpu_s);
  [[nodiscard]] std::optional<double> max_percent() const { return max_percent_; }

 private:
  struct Start {
    double ms = 0, cpu_s = 0;
  };
  std::optional<Start> window_;
  std::optional<double> max_percent_;
};

}  // namespace covey
