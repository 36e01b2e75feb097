// SPDX-License-Identifier: Apache-2.0
#include "apps/stop_signal.h"

#include <atomic>
#include <csignal>

namespace covey {
namespace {

std::atomic<bool> stop{false};
static_assert(std::atomic<bool>::is_always_lock_free, "a signal handler may not lock");

void on_signal(int) { stop.store(true); }

// What somebody has chosen to ignore stays ignored.
void release(int number) {
  struct sigaction action = {};
  sigaction(number, nullptr, &action);
  if (action.sa_handler != on_signal) return;
  action.sa_handler = SIG_DFL;
  sigaction(number, &action, nullptr);
}

}  // namespace

void catch_stop_signals() {
  struct sigaction action = {};
  action.sa_handler = on_signal;
  sigemptyset(&action.sa_mask);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

void release_stop_signals() {
  release(SIGINT);
  release(SIGTERM);
}

bool stop_requested() { return stop.load(); }

}  // namespace covey
