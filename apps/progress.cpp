// SPDX-License-Identifier: Apache-2.0
#include "apps/progress.h"

#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <string>

namespace covey {

using Clock = std::chrono::steady_clock;

Progress::Progress(std::size_t total, const char* what)
    : total_(total), what_(what), terminal_(::isatty(STDERR_FILENO) != 0), start_(Clock::now()) {}

void Progress::show(std::size_t done) {
  const double elapsed_s = std::chrono::duration<double>(Clock::now() - start_).count();
  const double every_s = terminal_ ? 0.2 : 5.0;
  if (elapsed_s < next_s_ && done < total_) return;
  next_s_ = elapsed_s + every_s;
  const double share = total_ > 0 ? static_cast<double>(done) / static_cast<double>(total_) : 1;
  const double left_s = done > 0 ? elapsed_s * (1 / share - 1) : 0;
  const std::string left = done > 0 ? std::to_string(std::lround(left_s)) + " s left" : "";
  constexpr int kWidth = 30;
  const std::string bar(static_cast<std::size_t>(kWidth * share), '#');
  if (terminal_)
    std::fprintf(stderr, "\r[%-*s] %zu/%zu %s %-12s", kWidth, bar.c_str(), done, total_, what_,
                 left.c_str());
  else
    std::fprintf(stderr, "%zu/%zu %s %s\n", done, total_, what_, left.c_str());
  if (terminal_ && done == total_) std::fputc('\n', stderr);
}

}  // namespace covey
