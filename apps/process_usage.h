// SPDX-License-Identifier: Apache-2.0
//
// What this process costs: CPU time of all its threads and memory.
#pragma once

#include <optional>

namespace covey {

[[nodiscard]] double steady_ms();  // ms, monotonic, from an arbitrary start

// ms of CPU time that the calling thread has used: what a stage costs, whoever else is running.
[[nodiscard]] double thread_cpu_ms();

[[nodiscard]] double process_cpu_s();  // s, user and system, all threads

// Peak of the resident memory, MiB. Read from /proc: what getrusage reports would include the
// program that started this one. Nothing where /proc is not there.
[[nodiscard]] std::optional<double> peak_rss_mib();

// Highest share of one core over windows of at least a second of wall time.
class CpuLoadMonitor {
 public:
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
