// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <thread>

#include "tests/comms/team_config.h"

namespace covey {

// Whether it became true before patience ended.
inline bool eventually(const std::function<bool()>& test) {
  const auto deadline = std::chrono::steady_clock::now() + kPatience;
  while (!test()) {
    if (std::chrono::steady_clock::now() > deadline) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

}  // namespace covey
