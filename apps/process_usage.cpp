// SPDX-License-Identifier: Apache-2.0
#include "apps/process_usage.h"

#include <sys/resource.h>

#include <algorithm>
#include <chrono>
#include <ctime>
#include <fstream>
#include <sstream>
#include <string>

namespace covey {

double steady_ms() {
  using Milliseconds = std::chrono::duration<double, std::milli>;
  return Milliseconds(std::chrono::steady_clock::now().time_since_epoch()).count();
}

double thread_cpu_ms() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) * 1e3 + static_cast<double>(now.tv_nsec) * 1e-6;
}

double process_cpu_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + static_cast<double>(t.tv_usec) * 1e-6;
  };
  return seconds(usage.ru_utime) + seconds(usage.ru_stime);
}

std::optional<double> memory_mib(const std::string& process, const std::string& field) {
  std::ifstream status("/proc/" + process + "/status");
  const std::string start = field + ":";
  std::string line;
  while (std::getline(status, line)) {
    if (line.rfind(start, 0) != 0) continue;
    double kib = 0;
    std::istringstream(line.substr(start.size())) >> kib;
    return kib / 1024;
  }
  return std::nullopt;
}

std::optional<double> peak_rss_mib() { return memory_mib("self", "VmHWM"); }

bool CpuLoadMonitor::due(double now_ms) const {
  constexpr double kWindowMs = 1000;
  return !window_ || now_ms - window_->ms >= kWindowMs;
}

void CpuLoadMonitor::sample(double now_ms, double cpu_s) {
  if (!due(now_ms)) return;
  if (window_) {
    const double percent = 100 * (cpu_s - window_->cpu_s) / ((now_ms - window_->ms) * 1e-3);
    max_percent_ = std::max(percent, max_percent_.value_or(0));
  }
  window_ = Start{now_ms, cpu_s};
}

}  // namespace covey
