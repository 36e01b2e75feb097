// SPDX-License-Identifier: Apache-2.0
//
// A team that no other process can hear.
#pragma once

#include <unistd.h>

#include <chrono>
#include <string>

#include "comms/peer_link.h"

namespace covey {

// Generous: a loaded machine makes a test slow, not red.
inline constexpr std::chrono::seconds kPatience{60};

inline LinkConfig team_config(const std::string& agent) {
  LinkConfig config;
  config.agent = agent;
  config.team = "test" + std::to_string(getpid());
  config.domain = 40 + getpid() % 60;  // ports below those that systems hand out
  config.max_agents = 8;
  return config;
}

}  // namespace covey
